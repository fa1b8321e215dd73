// SPDX-License-Identifier: GPL-3.0-or-later
// Real files of many CAD systems against an independent kernel's numbers (../shared/data/step/oracle.json), one line a file.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "mesh_truth.hpp"
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

/// Where the kernel is at fault: what is true is worked out a third way in kernel_faults_test.cpp, and the reader held to it there.
const std::map<std::string, std::string> kKernelFaults = {
    {"catia5_head_back.stp", "half spheres closed the wrong way round: volume 880 933; closed form 23 639, reader 23 631"},
    {"rhino8_boxed_sphere.step",
     "5 to 15 degrees at corners of tangent fillets, volume 732.01; meshes tend to 733.6, normals agree within 0.5 degrees, reader 733.65"},
    {"nist_mbe_pmi_11.stp", "volume 5138.63 by integral, 5126.04 by its own mesh; meshes tend to 5129.38, reader 5129.4"},
    {"onshape_proximal_shell.step", "volume 3506.99 by integral, 3535.98 by its own mesh; meshes tend to 3533.1, reader 3533.2"},
    {"zoo_ball_bearing.step", "volume 5436.26, a ball 137.862; Pappus 136.593 a ball, so 5423.57; reader 5423.6"},
    {"zoo_exhaust_manifold.step",
     "area 575 939, volume 587 981; Gauss over the whole patches 577 066 and 590 312; reader 577 070 and 590 340"},
};

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
      std::printf("%s %-44s %6.2fs refused %s: %s\n", ok ? "ok " : "BAD", name.c_str(), s, r.error()[0].code.c_str(),
                  r.error()[0].message.substr(0, 100).c_str());
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
    const nlohmann::json occ_lengths =
        occ.contains("edges") ? occ["edges"].value("length", nlohmann::json::object()) : nlohmann::json::object();
    std::string problems;
    const auto problem = [&](const std::string& what) { problems += " " + what; };
    char text[200];
    if (static_cast<int>(b.faces.size()) != want_faces)
      problem("faces " + std::to_string(b.faces.size()) + "/" + std::to_string(want_faces));
    if (b.solids_count != number_at<int>(occ, "solids"))
      problem("solids " + std::to_string(b.solids_count) + "/" + std::to_string(number_at<int>(occ, "solids")));
    if (number_at<bool>(trust, "area") && rel(b.area_mm2, area) > 1e-3)
      std::snprintf(text, sizeof text, "area %.5g/%.5g", b.area_mm2, area), problem(text);
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
    std::vector<int> want_euler = test::eulers_of_file(bytes);
    for (const auto& [body, c] : test::closedness(b)) {
      const auto it = std::find(want_euler.begin(), want_euler.end(), c.euler);
      if (c.odd_sides != 0 || it == want_euler.end()) continue;
      ++closed, want_euler.erase(it);
    }
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
    std::printf("%s %-44s %6.2fs %6zu tri%s\n",
                problems.empty() ? "ok "
                : is_excused     ? "(k)"
                                 : "BAD",
                name.c_str(), s, b.mesh.triangles.size(), problems.c_str());
    std::fflush(stdout);
  }
  std::printf("%d files, %d with differences, %d edges with a remark, %.2f s of one core\n", files, bad, edge_faults, total_s);
  EXPECT_EQ(bad, 0);
}

}  // namespace
}  // namespace asbuilt
