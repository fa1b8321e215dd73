// SPDX-License-Identifier: GPL-3.0-or-later
// Real files of many CAD systems against an independent kernel's numbers (../shared/data/step/oracle.json), one line a file.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

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

}  // namespace
}  // namespace asbuilt
