// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/path/chain.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt {

namespace {
constexpr double kGapMaxMm = 1.5;      // between the end of one edge and the start of the next
constexpr double kSmoothMaxRad = 0.35; // 20 degrees
constexpr double kCornerMaxRad = 2.1;  // 120 degrees
constexpr double kSkewMaxMm = 0.3;     // distance of the two lines where they should meet
constexpr double kAxisMaxRad = 0.09;   // 5 degrees: no turn of the tool at a joint

double angle_between(const Vec3& a, const Vec3& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

Joint joint_of(const PlacedEdge& a, const PlacedEdge& b, double reach, ChainLink& link) {
  if (a.is_closed || b.is_closed) return Joint::none;
  const CutterPlacement &pa = a.at.back(), &pb = b.at.front();
  const EdgeStation &sa = a.station.back(), &sb = b.station.front();
  if ((sa.p - sb.p).norm() > kGapMaxMm) return Joint::none;
  if (angle_between(pa.up, pb.up) > kAxisMaxRad) return Joint::none;
  const double turn = angle_between(sa.tau, sb.tau);
  if (turn < kSmoothMaxRad && (pa.tip - pb.tip).norm() < kGapMaxMm + reach * turn) return Joint::smooth;
  if (turn > kCornerMaxRad) return Joint::none;
  // pa.tip + x ta and pb.tip - y tb at their closest
  const Vec3 &ta = sa.tau, &tb = sb.tau;
  const Vec3 d = pb.tip - pa.tip;
  const double c = ta.dot(tb), det = 1 - c * c;
  if (det < 1e-6) return Joint::none;
  const double x = (d.dot(ta) - c * d.dot(tb)) / det, y = (d.dot(tb) - c * d.dot(ta)) / det;  // minimises |d - y tb - x ta|
  if (x < 0.2 || y < 0.2 || x > reach || y > reach) return Joint::none;
  link.corner_out = pa.tip + x * ta, link.corner_in = pb.tip - y * tb;
  return (link.corner_out - link.corner_in).norm() <= kSkewMaxMm ? Joint::corner : Joint::none;
}
}  // namespace

bool is_climb(const EdgeStation& station, const CutterPlacement& at) {
  const Vec3 towards_material = -(at.m - at.up * at.up.dot(at.m));
  return towards_material.dot(station.tau.cross(at.up)) > 0;
}

std::vector<Chain> chain_edges(const std::vector<PlacedEdge>& edges, double reach_mm) {
  const int n = static_cast<int>(edges.size());
  std::vector<int> next(static_cast<std::size_t>(n), -1), before(static_cast<std::size_t>(n), -1);
  std::vector<ChainLink> link(static_cast<std::size_t>(n));
  struct Candidate {
    double gap;
    int a, b;
    ChainLink link;
  };
  std::vector<Candidate> all;
  for (int a = 0; a < n; ++a)
    for (int b = 0; b < n; ++b) {
      if (a == b) continue;
      ChainLink l;
      const Joint j = joint_of(edges[static_cast<std::size_t>(a)], edges[static_cast<std::size_t>(b)], reach_mm, l);
      if (j == Joint::none) continue;
      l.placed = a, l.to_next = j;
      all.push_back({(edges[static_cast<std::size_t>(a)].station.back().p - edges[static_cast<std::size_t>(b)].station.front().p).norm(), a, b, l});
    }
  std::stable_sort(all.begin(), all.end(), [](const Candidate& x, const Candidate& y) { return x.gap < y.gap; });
  for (const Candidate& c : all) {
    if (next[static_cast<std::size_t>(c.a)] >= 0 || before[static_cast<std::size_t>(c.b)] >= 0) continue;
    next[static_cast<std::size_t>(c.a)] = c.b, before[static_cast<std::size_t>(c.b)] = c.a, link[static_cast<std::size_t>(c.a)] = c.link;
  }
  std::vector<Chain> out;
  std::vector<char> used(static_cast<std::size_t>(n), 0);
  const auto follow = [&](int first) {
    Chain chain;
    for (int k = first; k >= 0 && !used[static_cast<std::size_t>(k)]; k = next[static_cast<std::size_t>(k)]) {
      used[static_cast<std::size_t>(k)] = 1;
      ChainLink l = link[static_cast<std::size_t>(k)];
      l.placed = k;
      chain.links.push_back(l);
    }
    chain.is_closed = next[static_cast<std::size_t>(chain.links.back().placed)] == first;
    if (edges[static_cast<std::size_t>(first)].is_closed) chain.is_closed = true;
    out.push_back(chain);
  };
  for (int k = 0; k < n; ++k)
    if (before[static_cast<std::size_t>(k)] < 0) follow(k);
  for (int k = 0; k < n; ++k)
    if (!used[static_cast<std::size_t>(k)]) follow(k);  // what is left are rings
  std::stable_sort(out.begin(), out.end(), [](const Chain& a, const Chain& b) { return a.links.front().placed < b.links.front().placed; });
  return out;
}

}  // namespace asbuilt
