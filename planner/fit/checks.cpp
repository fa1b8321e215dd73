// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fit/checks.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <tuple>

#include "planner/base/number.hpp"

namespace asbuilt::fitting {

namespace {

constexpr double kGapMax_mm = 10, kUnseenShareMax = 0.15;
constexpr int kPointsMin = 15;

std::string name_edge(const Setup& setup, std::size_t e, const Job& job) {
  return "edge " + job.part.brep.edges[setup.edges[e].edge].id + " of " + setup.edges[e].feature;
}
double length_of(const EdgeModel& e) {
  double s = 0;
  for (std::size_t i = 1; i < e.nominal.size(); ++i) s += (e.nominal[i] - e.nominal[i - 1]).norm();
  return s;
}

}  // namespace

Refusals check_seen(const Setup& setup, const std::vector<Cell>& cells, const Job& job) {
  Refusals out;
  for (std::size_t e = 0; e < setup.edges.size(); ++e) {
    const EdgeModel& edge = setup.edges[e];
    const double length = length_of(edge);
    for (const int slot : {edge.slot_1, edge.slot_2}) {
      std::vector<double> seen;
      int points = 0;
      for (const Cell& c : cells)
        if (c.slot == slot && c.edge == static_cast<int>(e)) seen.push_back(c.s_mm), points += c.points_count;
      std::sort(seen.begin(), seen.end());
      // Length farther than the reach from anything seen on this side.
      double unseen = 0, gap_at = 0, gap_largest = 0;
      double before = -1e300;
      const auto gap = [&](double a, double b) {  // [a, b] holds nothing
        const double left = std::max(0.0, a), right = std::min(length, b);
        if (right - left > gap_largest) gap_largest = right - left, gap_at = 0.5 * (left + right);
        const double from = std::max(0.0, a < 0 ? 0.0 : a + 2.5), to = std::min(length, b > length ? length : b - 2.5);
        if (to - from > kGapMax_mm) unseen += to - from;
      };
      for (const double s : seen) {
        if (s - before > 5) gap(before, s);
        before = s;
      }
      gap(before, 1e300);
      const std::string& face = job.part.brep.faces[setup.faces[slot].face].id;
      if (seen.empty() || unseen > kUnseenShareMax * length || gap_largest > std::max(2 * kGapMax_mm, 0.3 * length)) {
        const double number = seen.empty() ? length : std::max(unseen, gap_largest);
        out.push_back({.code = "fit.edge_not_seen", .where = name_edge(setup, e, job) + " at " + fixed_number(gap_at, 1) + " mm",
                       .message = "Face " + face + " was not seen along " + fixed_number(number, 1) + " mm of the edge's " +
                                  fixed_number(length, 1) + " mm. Add a capture that looks at this face beside the edge.",
                       .measured = number, .limit = seen.empty() ? 0.0 : 2 * kGapMax_mm, .unit = "mm", .stage = "fit"});
        break;
      }
      if (points < kPointsMin) {
        out.push_back({.code = "fit.too_few_points", .where = name_edge(setup, e, job),
                       .message = "Face " + face + " has " + std::to_string(points) + " points beside the edge; at least " +
                                  std::to_string(kPointsMin) + " are needed. Scan it closer or with more captures.",
                       .measured = static_cast<double>(points), .limit = kPointsMin, .unit = "points", .stage = "fit"});
        break;
      }
    }
  }
  return out;
}

Refusals check_traced(const FitRecipe& recipe, const Setup& setup, const std::vector<Traced>& traced, const Job& job) {
  Refusals out;
  for (std::size_t e = 0; e < traced.size(); ++e) {
    const Traced& t = traced[e];
    if (t.bad_station >= 0) {
      const double angle_deg = deg_from_rad(t.bad_angle_rad);
      out.push_back({.code = "fit.tangent", .where = name_edge(setup, e, job) + ", station " + std::to_string(t.bad_station),
                     .message = "The fitted faces meet at " + fixed_number(angle_deg, 1) +
                                " degrees or not at all; no edge can be found there. Look at the scan of this place or take the edge out.",
                     .measured = angle_deg, .limit = 10, .unit = "deg", .stage = "fit"});
      continue;
    }
    double worst = 0, at = 0, s = 0;
    for (std::size_t i = 0; i < t.adapted.size(); ++i) {
      if (i > 0) s += (t.adapted[i] - t.adapted[i - 1]).norm();
      Vec3 v = t.adapted[i] - t.nominal[i];
      v -= t.tangent[i] * t.tangent[i].dot(v);
      if (v.norm() > worst) worst = v.norm(), at = s;
    }
    if (worst > recipe.deviation_max_mm)
      out.push_back({.code = "fit.deviation_above_limit", .where = name_edge(setup, e, job) + " at " + fixed_number(at, 1) + " mm",
                     .message = "The edge lies " + fixed_number(worst, 2) + " mm from the drawing at the located place; at most " +
                                fixed_number(recipe.deviation_max_mm, 2) + " mm is allowed. Check the part, its revision and the scan.",
                     .measured = worst, .limit = recipe.deviation_max_mm, .unit = "mm", .stage = "fit"});
  }
  return out;
}

Disagreement worst_disagreement(const Setup& setup, const MeasuredCloud& cloud, const Location& location, const std::vector<Cell>& cells,
                                const Bundle& bundle) {
  // By face and 4 mm cube: each capture's residual there. Only what two captures saw of the same place is compared, so that a
  // face's form is no disagreement. Not the robust weight: what is thrown out for disagreeing is what is asked for here.
  constexpr double kCube_mm = 4;
  std::map<std::array<std::int64_t, 4>, std::map<int, std::pair<double, double>>> cubes;
  const auto T_part_base = location.T_base_part.inverse();
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const Cell& c = cells[i];
    if (!setup.is_fine[c.capture]) continue;
    const Eigen::Array3d p = (T_part_base.point(setup.captures[c.capture].correction.point(c.p_base)) / kCube_mm).array().floor();
    const std::array<std::int64_t, 4> place{c.slot, static_cast<std::int64_t>(p.x()), static_cast<std::int64_t>(p.y()),
                                            static_cast<std::int64_t>(p.z())};
    auto& a = cubes[place][c.capture];
    a.first += bundle.residual_mm[i], a.second += 1;
  }
  std::map<std::array<int, 3>, std::vector<double>> differences;  // (slot, capture, capture)
  for (const auto& [place, by_capture] : cubes)
    for (auto a = by_capture.begin(); a != by_capture.end(); ++a)
      for (auto b = std::next(a); b != by_capture.end(); ++b)
        differences[{static_cast<int>(place[0]), a->first, b->first}].push_back(a->second.first / a->second.second -
                                                                                b->second.first / b->second.second);
  Disagreement out;
  for (auto& [key, d] : differences) {
    if (d.size() < 10) continue;
    std::nth_element(d.begin(), d.begin() + static_cast<std::ptrdiff_t>(d.size() / 2), d.end());
    const double middle = std::abs(d[d.size() / 2]);
    if (middle <= out.distance_mm) continue;
    out.distance_mm = middle, out.places_count = static_cast<int>(d.size());
    out.slot = key[0], out.capture_a = key[1], out.capture_b = key[2];
  }
  for (std::size_t k = 0; k < cloud.captures.size(); ++k)
    if (setup.is_fine[k]) out.noise_mm = std::max(out.noise_mm, cloud.captures[k].noise_mm);
  return out;
}

Refusals check_captures(const Solved& s) {
  const Disagreement found = worst_disagreement(s.setup, s.cloud, s.location, s.cells, s.bundle);
  const double worst = found.distance_mm, limit = 0.08 + 3 * found.noise_mm;
  const int capture_a = found.capture_a, capture_b = found.capture_b, slot = found.slot;
  if (worst <= limit) return {};
  return {{.code = "fit.captures_contradict",
           .where = s.cloud.captures[capture_a].name + " and " + s.cloud.captures[capture_b].name + ", face " +
                    s.job.part.brep.faces[s.setup.faces[slot].face].id,
           .message = "The two captures put one face " + fixed_number(worst, 3) + " mm apart; the robot's error explains at most " +
                      fixed_number(limit, 3) + " mm after both were corrected. Check the calibration of the sensor and whether the part moved, then scan again.",
           .measured = worst, .limit = limit, .unit = "mm", .stage = "fit"}};
}

Refusals check_broken(const Solved& s, const Features& features) {
  Refusals out;
  std::vector<std::vector<Vec3>> lines;
  for (const AdaptedEdge& e : features.edges) lines.push_back(e.adapted);
  constexpr double kLook_mm = 3.0;
  const PolylineIndex index(lines, kLook_mm);
  const Pose<frame::Part, frame::Base> T_part_base = s.location.T_base_part.inverse();
  struct Bin {
    std::vector<double> depth;   // of points within the wedge and off both faces: a surface that the drawing does not have
    std::size_t whole = 0;       // points on a face right beside the edge: what a broken edge has none of
  };
  std::vector<std::vector<Bin>> bins(features.edges.size());  // by edge, by mm along it
  for (std::size_t e = 0; e < bins.size(); ++e) bins[e].resize(static_cast<std::size_t>(features.edges[e].s_mm.back()) + 1);
  std::vector<PolylineFoot> near;
  for (std::size_t k = 0; k < s.cloud.captures.size(); ++k) {
    if (!s.setup.is_fine[k]) continue;
    const auto T = T_part_base * features.corrections[k];
    for (std::size_t i = s.cloud.captures[k].begin; i < s.cloud.captures[k].end; ++i) {
      const Vec3 p = T.point(s.cloud.p_base[i]);
      index.near(p, near);
      for (const PolylineFoot& f : near) {
        if (f.is_beyond || !s.setup.edges[f.line].is_convex) continue;
        const AdaptedEdge& e = features.edges[f.line];
        const Vec3 v = p - f.p;
        const double f_1 = v.dot(e.n_1[f.segment]), f_2 = v.dot(e.n_2[f.segment]);
        Bin& bin = bins[f.line][std::min(bins[f.line].size() - 1, static_cast<std::size_t>(f.s_mm))];
        if (f_1 < -0.12 && f_2 < -0.12 && f_1 > -2.0 && f_2 > -2.0) bin.depth.push_back(-std::max(f_1, f_2));
        if (std::abs(std::max(f_1, f_2)) < 0.06 && std::min(f_1, f_2) < -0.08 && std::min(f_1, f_2) > -0.35) ++bin.whole;
      }
    }
  }
  for (std::size_t e = 0; e < bins.size(); ++e) {
    std::size_t broken = 0;
    std::vector<double> all;
    for (const Bin& bin : bins[e]) {
      if (bin.depth.size() < 4 || bin.depth.size() < 2 * bin.whole) continue;
      ++broken;
      all.insert(all.end(), bin.depth.begin(), bin.depth.end());
    }
    if (all.empty() || static_cast<double>(broken) < 0.3 * static_cast<double>(bins[e].size())) continue;
    std::sort(all.begin(), all.end());
    const double number = all[all.size() * 9 / 10];
    out.push_back({.code = "fit.edge_broken", .where = name_edge(s.setup, e, s.job),
                   .message = "Along " + std::to_string(broken) + " mm of the edge the material is already gone, " + fixed_number(number, 2) +
                              " mm below both faces: the edge is chamfered, rounded or broken off. Take it out of the feature or check the part.",
                   .measured = number, .limit = 0.12, .unit = "mm", .stage = "fit"});
  }
  return out;
}

}  // namespace asbuilt::fitting
