// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/geom/edge_chains.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt {
namespace {

struct End {
  int edge = -1;
  bool is_last = false;
  Vec3 p, out;       // the end, and the direction in which the edge leaves there
  int partner = -1;  // index of the end it runs on over
};

bool is_sharp(const BrepEdge& e) { return e.kind == EdgeKind::sharp_convex || e.kind == EdgeKind::sharp_concave; }

}  // namespace

std::vector<EdgeChain> edge_chains(const Brep& brep, double turn_rad) {
  std::vector<End> ends;
  std::vector<int> first_end(brep.edges.size(), -1);
  for (std::size_t k = 0; k < brep.edges.size(); ++k) {
    const BrepEdge& e = brep.edges[k];
    if (!is_sharp(e) || e.is_seam || e.is_closed || e.p.size() < 2) continue;
    first_end[k] = static_cast<int>(ends.size());
    ends.push_back({static_cast<int>(k), false, e.p.front(), -e.tangent.front(), -1});
    ends.push_back({static_cast<int>(k), true, e.p.back(), e.tangent.back(), -1});
  }
  std::vector<int> order(ends.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
  const auto end = [&](int i) -> End& { return ends[static_cast<std::size_t>(i)]; };
  std::sort(order.begin(), order.end(), [&](int a, int b) { return end(a).p.x() != end(b).p.x() ? end(a).p.x() < end(b).p.x() : a < b; });
  constexpr double touch_mm = 1e-3;
  const auto body = [&](const End& a) {
    return brep.faces[static_cast<std::size_t>(brep.edges[static_cast<std::size_t>(a.edge)].face_1)].body;
  };
  std::vector<int> best(ends.size(), -1);
  for (std::size_t i = 0; i < order.size(); ++i) {
    End& a = end(order[i]);
    double straightest = turn_rad, second = 1e9;
    const auto look = [&](std::size_t j) {
      const End& b = end(order[j]);
      if (b.edge == a.edge || (b.p - a.p).norm() > touch_mm || body(a) != body(b)) return;
      if (brep.edges[static_cast<std::size_t>(a.edge)].kind != brep.edges[static_cast<std::size_t>(b.edge)].kind) return;
      const double turn = std::atan2(a.out.cross(b.out).norm(), -a.out.dot(b.out));
      if (turn < straightest)
        second = best[static_cast<std::size_t>(order[i])] >= 0 ? straightest : second, straightest = turn,
        best[static_cast<std::size_t>(order[i])] = order[j];
      else
        second = std::min(second, turn);
    };
    for (std::size_t j = i; j-- > 0 && a.p.x() - end(order[j]).p.x() <= touch_mm;) look(j);
    for (std::size_t j = i + 1; j < order.size() && end(order[j]).p.x() - a.p.x() <= touch_mm; ++j) look(j);
    if (second < straightest + rad_from_deg(1)) best[static_cast<std::size_t>(order[i])] = -1;
  }
  for (std::size_t i = 0; i < ends.size(); ++i)
    if (best[i] >= 0 && best[static_cast<std::size_t>(best[i])] == static_cast<int>(i)) ends[i].partner = best[i];
  std::vector<EdgeChain> out;
  std::vector<bool> done(brep.edges.size(), false);
  for (std::size_t k = 0; k < brep.edges.size(); ++k) {
    const BrepEdge& e = brep.edges[k];
    if (!is_sharp(e) || e.is_seam || done[k] || e.p.size() < 2) continue;
    EdgeChain c;
    c.kind = e.kind;
    const auto add = [&](int edge, bool forward) {
      done[static_cast<std::size_t>(edge)] = true;
      c.edges.push_back(edge), c.is_forward.push_back(forward);
      c.length_mm += brep.edges[static_cast<std::size_t>(edge)].length_mm;
    };
    if (e.is_closed) {
      add(static_cast<int>(k), true), c.is_closed = true;
    } else {
      int at = first_end[k];  // back to where the chain begins, or around to this edge again
      for (std::size_t n = 0; n < ends.size(); ++n) {
        const int p = end(at).partner;
        if (p < 0 || end(p).edge == static_cast<int>(k)) break;
        at = end(p).is_last ? p - 1 : p + 1;
      }
      if (end(at).partner >= 0) at = first_end[k], c.is_closed = true;
      for (;;) {  // `at` is the end where an edge is entered
        add(end(at).edge, !end(at).is_last);
        const int p = end(end(at).is_last ? at - 1 : at + 1).partner;
        if (p < 0 || done[static_cast<std::size_t>(end(p).edge)]) break;
        at = p;
      }
    }
    c.id = brep.edges[static_cast<std::size_t>(*std::min_element(c.edges.begin(), c.edges.end()))].id;
    out.push_back(std::move(c));
  }
  return out;
}

}  // namespace asbuilt
