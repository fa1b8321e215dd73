// SPDX-License-Identifier: GPL-3.0-or-later
// Faults of growing size built into virtual parts, and what gets through the gate. An emitted edge is out of tolerance when less
// than 95 % of its length would have both legs of the chamfer in tolerance in the place the robot really touches.
//   study_gate [--runs 500] [--cache DIR] [--parts bracket,ring] [--width MM --tolerance MM]
// Exit status 3 when an edge that is out of tolerance was let through.
#include <fmt/format.h>

#include <cstdio>
#include <map>
#include <sstream>

#include "tests/bench/actual/study.hpp"

using namespace asbuilt;

namespace {

struct Fault {
  const char* trap;  // "": a good part
  double size;
};
/// From hardly there to gross; the good parts are every fifth run.
constexpr Fault kFaults[] = {{"", 0},          {"hand_eye", 0.1}, {"points_lost", 0.3}, {"revision", 0.3},    {"scale", 0.1},
                             {"", 0},          {"hand_eye", 0.3}, {"points_lost", 0.6}, {"revision", 1.0},    {"scale", 0.5},
                             {"", 0},          {"hand_eye", 1.0}, {"points_lost", 0.9}, {"part_moved", 0.3},  {"tool_bumped", 0.3},
                             {"", 0},          {"hand_eye", 2.0}, {"edge_broken", 1.0}, {"part_moved", 1.0},  {"scale", 2.0}};

struct Row {
  int runs = 0, emitted = 0, edges = 0, edges_bad = 0;
  std::map<std::string, int> refused;
};

}  // namespace

int main(int argc, char** argv) {
  int runs = 500;
  double width = 0, tolerance = 0;
  std::string cache = "study_cache", list = "bracket,ring";
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string a = argv[i];
    if (a == "--runs") runs = std::stoi(argv[i + 1]);
    if (a == "--cache") cache = argv[i + 1];
    if (a == "--parts") list = argv[i + 1];
    if (a == "--width") width = std::stod(argv[i + 1]);
    if (a == "--tolerance") tolerance = std::stod(argv[i + 1]);
  }
  std::vector<std::string> parts;
  std::stringstream s(list);
  for (std::string one; std::getline(s, one, ',');) parts.push_back(one);
  std::map<std::string, Row> table;
  int bad = 0;
  for (int k = 0; k < runs; ++k) {
    const Fault& fault = kFaults[static_cast<std::size_t>(k) % std::size(kFaults)];
    Scenario sc;
    sc.part = parts[static_cast<std::size_t>(k / 4) % parts.size()];
    sc.seed = 1000 + static_cast<std::uint64_t>(k), sc.is_light = true;
    sc.trap = fault.trap, sc.trap_size = fault.size, sc.width_mm = width, sc.tolerance_mm = tolerance;
    const study::Run r = study::run(sc, {.cache = cache, .is_kept = false});
    Row& row = table[sc.trap.empty() ? "(good part)" : fmt::format("{} {:.1f}", fault.trap, fault.size)];
    ++row.runs;
    std::map<int, std::pair<int, int>> by_edge;
    for (const study::Station& x : r.stations) ++by_edge[x.edge].second, by_edge[x.edge].first += x.is_within;
    int out = 0;
    for (const auto& [edge, n] : by_edge) out += n.first < 0.95 * n.second;
    if (r.is_planned()) {
      ++row.emitted, row.edges += static_cast<int>(by_edge.size()), row.edges_bad += out, bad += out;
    } else {
      ++row.refused[r.code];
    }
    std::printf("%3d %-8s %-12s %.1f %s %s | edges out of tolerance %d of %zu\n", k, sc.part.c_str(), fault.trap, fault.size, r.is_planned() ? "emitted" : "refused", r.code.c_str(), out, by_edge.size());
    std::fflush(stdout);
  }
  std::printf("\n%-18s %5s %8s %14s  refused by\n", "fault", "runs", "emitted", "edges out/of");
  for (const auto& [name, row] : table) {
    std::string why;
    for (const auto& [code, n] : row.refused) why += fmt::format("{} x{}  ", code, n);
    std::printf("%-18s %5d %8d %7d/%-7d %s\n", name.c_str(), row.runs, row.emitted, row.edges_bad, row.edges, why.c_str());
  }
  std::printf("emitted edges out of tolerance: %d\n", bad);
  return bad > 0 ? 3 : 0;
}
