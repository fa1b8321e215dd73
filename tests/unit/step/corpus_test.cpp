// SPDX-License-Identifier: GPL-3.0-or-later
// Real files of many CAD systems against an independent kernel's numbers (../shared/data/step/oracle.json), one line a file.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <ctime>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "planner/io/step/step_reader.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;

std::string bytes_of(const fs::path& p) {
  std::ifstream in(p, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

std::map<std::string, double> lengths(const Brep& b) {
  std::map<std::string, double> m;
  for (const BrepEdge& e : b.edges)
    if (!e.is_seam) m[std::string(name_of(e.kind))] += e.length_mm;
  return m;
}

TEST(BatchParts, AreReadWhole) {
  const fs::path root = "../shared/data/batches";
  if (!fs::exists(root)) GTEST_SKIP() << "no ../shared/data/batches here";
  for (const std::string part : {"ring", "bracket", "casting"}) {
    const auto t0 = std::chrono::steady_clock::now();
    const auto r = read_step(bytes_of(root / part / "batch" / (part + ".step")), part + ".step");
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - t0).count();
    ASSERT_TRUE(r) << r.error()[0].message;
    const Brep& b = r->artefact;
    std::printf("%-8s %zu faces %zu edges %zu triangles area %.3f volume %.3f open %d  %.3f s\n", part.c_str(), b.faces.size(),
                b.edges.size(), b.mesh.triangles.size(), b.area_mm2, b.volume_mm3, b.open_edges_count, seconds);
    for (const auto& [kind, length] : lengths(b)) std::printf("    %s %.2f mm\n", kind.c_str(), length);
    EXPECT_EQ(b.open_edges_count, 0);
    EXPECT_EQ(b.solids_count, 1);
    EXPECT_TRUE(b.unread.empty());
    EXPECT_GT(b.volume_mm3, 0);
    for (const BrepFace& f : b.faces) EXPECT_EQ(f.fault, "") << f.id;
    for (const BrepEdge& e : b.edges) EXPECT_EQ(e.fault, "") << e.id;
  }
}

double rel(double a, double b) { return b != 0 ? std::abs(a - b) / std::abs(b) : std::abs(a); }

/// The oracle's word for a surface -> ours.
std::string kind_of_oracle(const std::string& k) {
  if (k.rfind("BSpline", 0) == 0 || k.rfind("Bezier", 0) == 0) return "bspline";
  if (k == "SurfaceOfRevolution") return "revolution";
  if (k == "SurfaceOfExtrusion") return "extrusion";
  if (k == "OffsetSurface") return "offset";
  std::string s = k;
  for (char& c : s) c = static_cast<char>(std::tolower(c));
  if (s == "toroid") return "torus";
  return s;
}

/// Number at a key; 0 where it is absent or null.
template <class T>
T number_at(const nlohmann::json& j, const std::string& key) {
  return j.is_object() && j.contains(key) && (j[key].is_number() || j[key].is_boolean()) ? j[key].get<T>() : T{};
}

/// Where the kernel is at fault, and how that is known.
const std::map<std::string, std::string> kKernelFaults = {
    {"fc_key_ring.step", "its mesh has a third of the true area (named in the oracle's notes)"},
    {"catia5_head_back.stp",
     "it closes the half spheres the wrong way round: volume 880 933 = a full ball; the file is a shell of 1 mm between R 60 and R 59 whose rim, "
     "a plane ring of pi (60^2 - 59^2) = 373.8 mm2, both readers measure alike"},
    {"rhino8_boxed_sphere.step", "it sees 5 to 15 degrees at degenerate corners of tangent fillets; the normals of the surfaces agree within 0.4"},
    {"nist_mbe_pmi_11.stp", "volume: its integral 5138.6 and its own mesh 5126.0 differ by 0.25 %; ours converges to 5129.4 under refinement"},
    {"onshape_proximal_shell.step", "volume: its integral 3507.0 and its own mesh 3536.0 differ by 0.8 %; ours converges to 3533.2"},
    {"zoo_ball_bearing.step", "volume: its integral 5436.3 and its own mesh 5419.9 differ by 0.3 %; ours converges to 5423.6"},
    {"zoo_exhaust_manifold.step", "area: its integral 575 939 and its own mesh 576 589 differ by 0.11 %; ours converges to 577 070 on thin closed B-spline tubes"},
};

/// Sides of the triangles of one body that do not have exactly one partner the other way, and V - E + F.
struct Closedness {
  int odd_sides = 0, euler = 0;
};
std::map<int, Closedness> closedness(const Brep& b) {
  std::map<int, std::map<std::pair<int, int>, std::pair<int, int>>> sides;
  std::map<int, std::set<int>> vertices;
  std::map<int, Closedness> out;
  for (std::size_t t = 0; t < b.mesh.triangles.size(); ++t) {
    const int body = b.faces[static_cast<std::size_t>(b.triangle_face[t])].body;
    ++out[body].euler;
    for (std::size_t k = 0; k < 3; ++k) {
      const int p = b.mesh.triangles[t][k], q = b.mesh.triangles[t][(k + 1) % 3];
      auto& s = sides[body][{std::min(p, q), std::max(p, q)}];
      ++(p < q ? s.first : s.second);
      vertices[body].insert(p);
    }
  }
  for (auto& [body, c] : out) {
    c.euler += static_cast<int>(vertices[body].size()) - static_cast<int>(sides[body].size());
    for (const auto& [key, n] : sides[body]) c.odd_sides += n.first != 1 || n.second != 1;
  }
  return out;
}

TEST(Corpus, AgreesWithAnIndependentKernel) {
  const fs::path root = "../shared/data/step";
  if (!fs::exists(root / "oracle.json")) GTEST_SKIP() << "no ../shared/data/step here";
  const auto oracle = nlohmann::json::parse(std::ifstream(root / "oracle.json"))["files"];
  const char* only = std::getenv("ASBUILT_STEP_ONLY");
  double total_s = 0;
  int bad = 0, files = 0, edge_faults = 0;
  for (const auto& [name, entry] : oracle.items()) {
    nlohmann::json o = entry;
    if (only && name.find(only) == std::string::npos) continue;
    ++files;
    const std::string bytes = bytes_of(root / name);
    const std::clock_t t0 = std::clock();
    const auto r = read_step(bytes, name);
    const double s = static_cast<double>(std::clock() - t0) / CLOCKS_PER_SEC;
    total_s += s;
    const int want_faces = o["occ"].is_object() ? number_at<int>(o["occ"], "faces") : 0;
    if (!r) {
      const bool ok = want_faces == 0;
      bad += !ok;
      std::printf("%s %-44s %6.2fs refused %s: %s\n", ok ? "ok " : "BAD", name.c_str(), s, r.error()[0].code.c_str(), r.error()[0].message.substr(0, 100).c_str());
      continue;
    }
    const Brep& b = r->artefact;
    if (o.contains("tessellated_solids")) {  // triangles only: nothing but their sums can be compared
      const auto& t = o["tessellated_solids"][0];
      const bool ok = rel(b.area_mm2, number_at<double>(t, "area")) < 1e-6 && rel(b.volume_mm3, number_at<double>(t, "volume")) < 1e-5;
      bad += !ok;
      std::printf("%s %-44s %6.2fs %6zu tri given as triangles\n", ok ? "ok " : "BAD", name.c_str(), s, b.mesh.triangles.size());
      continue;
    }
    nlohmann::json occ = o["occ"].is_object() ? o["occ"] : nlohmann::json::object();
    const double area = number_at<double>(occ, "area"), volume = number_at<double>(occ, "volume");
    const nlohmann::json trust = o["trust"].is_object() ? o["trust"] : nlohmann::json::object();
    const nlohmann::json occ_lengths = occ.contains("edges") ? occ["edges"].value("length", nlohmann::json::object()) : nlohmann::json::object();
    std::string problems;
    const auto problem = [&](const std::string& what) { problems += " " + what; };
    char text[200];
    if (static_cast<int>(b.faces.size()) != want_faces) problem("faces " + std::to_string(b.faces.size()) + "/" + std::to_string(want_faces));
    if (b.solids_count != number_at<int>(occ, "solids")) problem("solids " + std::to_string(b.solids_count) + "/" + std::to_string(number_at<int>(occ, "solids")));
    if (number_at<bool>(trust, "area") && rel(b.area_mm2, area) > 1e-3) std::snprintf(text, sizeof text, "area %.5g/%.5g", b.area_mm2, area), problem(text);
    if (number_at<bool>(trust, "volume") && b.solids_count > 0 && rel(b.volume_mm3, volume) > 1e-3)
      std::snprintf(text, sizeof text, "volume %.5g/%.5g", b.volume_mm3, volume), problem(text);
    auto mine = lengths(b);
    if (number_at<bool>(trust, "edges")) {
      const double want = number_at<double>(occ_lengths, "sharp_convex");
      if (rel(mine["sharp_convex"], want) > 5e-3 && std::abs(mine["sharp_convex"] - want) > 1e-3)
        std::snprintf(text, sizeof text, "convex %.5g/%.5g", mine["sharp_convex"], want), problem(text);
      double total = 0;
      for (const auto& [k, v] : occ_lengths.items()) total += number_at<double>(occ_lengths, k);
      for (const std::string k : {"sharp_concave", "smooth", "near"}) {
        const double w = number_at<double>(occ_lengths, k);
        if (std::abs(mine[k] - w) > 0.01 * total) std::snprintf(text, sizeof text, "%s %.5g/%.5g", k.c_str(), mine[k], w), problem(text);
      }
    }
    std::map<std::string, int> by_mine, by_oracle;
    for (const BrepFace& f : b.faces) ++by_mine[std::string(surface_type(f.surface))];
    const nlohmann::json kinds = occ.value("faces_by_surface", nlohmann::json::object());
    for (const auto& [k, v] : kinds.items()) by_oracle[kind_of_oracle(k)] += number_at<int>(v, "n");
    if (by_mine != by_oracle) problem("kinds");
    int closed = 0;
    for (const auto& [body, c] : closedness(b)) closed += c.odd_sides == 0 && c.euler % 2 == 0;
    if (closed < b.solids_count) problem("closed solids " + std::to_string(closed) + "/" + std::to_string(b.solids_count));
    int faults = 0;
    for (const BrepEdge& e : b.edges) edge_faults += !e.fault.empty();
    std::string first;
    for (const BrepFace& f : b.faces)
      if (!f.fault.empty() && faults++ == 0) first = f.id + " " + std::string(surface_type(f.surface)) + ": " + f.fault;
    if (faults) problem("faults " + std::to_string(faults) + " [" + first + "]");
    if (!b.unread.empty()) problem("unread " + std::to_string(b.unread.size()) + " [" + b.unread[0].why + "]");
    const bool is_excused = kKernelFaults.count(name) > 0;
    bad += !problems.empty() && !is_excused;
    std::printf("%s %-44s %6.2fs %6zu tri%s\n", problems.empty() ? "ok " : is_excused ? "(k)" : "BAD", name.c_str(), s, b.mesh.triangles.size(), problems.c_str());
    std::fflush(stdout);
  }
  std::printf("%d files, %d with differences, %d edges with a remark, %.2f s of one core\n", files, bad, edge_faults, total_s);
  EXPECT_EQ(bad, 0);
}

}  // namespace
}  // namespace asbuilt
