// SPDX-License-Identifier: GPL-3.0-or-later
// Which edges of the CAD a feature means: by nearest point, by id, by face, by box. Frame: part. Nothing is chosen by guess.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "planner/geom/edge_chains.hpp"
#include "planner/inputs/item.hpp"

namespace asbuilt::inputs {

namespace {

bool is_sharp(const BrepEdge& e) { return e.kind == EdgeKind::sharp_convex || e.kind == EdgeKind::sharp_concave; }

double distance_to(const BrepEdge& e, const Vec3& p) {
  double best = 1e300;
  for (std::size_t i = 0; i + 1 < e.p.size(); ++i) {
    const Vec3 d = e.p[i + 1] - e.p[i];
    const double l2 = d.squaredNorm();
    const double t = l2 > 0 ? std::clamp((p - e.p[i]).dot(d) / l2, 0.0, 1.0) : 0.0;
    best = std::min(best, (p - e.p[i] - t * d).norm());
  }
  if (e.p.size() == 1) best = (p - e.p[0]).norm();
  return best;
}

/// Where two edges meet end to end, does the one run on as the other?
bool runs_on(const BrepEdge& a, const BrepEdge& b) {
  if (a.p.empty() || b.p.empty() || a.is_closed || b.is_closed) return false;
  for (const std::size_t i : {std::size_t(0), a.p.size() - 1})
    for (const std::size_t j : {std::size_t(0), b.p.size() - 1})
      if ((a.p[i] - b.p[j]).norm() < 1e-3 && std::abs(a.tangent[i].dot(b.tangent[j])) > std::cos(rad_from_deg(2))) return true;
  return false;
}

std::string text_of(const Vec3& p) { return fmt::format("[{:g}, {:g}, {:g}]", p.x(), p.y(), p.z()); }

struct Choice {
  Item& item;
  const Brep& brep;
  const std::string& feature_id;
  bool needs_convex;
  std::set<int> edges;

  /// What the CAD reader could not read exactly at the edge or its faces; empty where all is exact.
  std::string unread(int index) const {
    const BrepEdge& e = brep.edges[std::size_t(index)];
    std::string text = e.fault;
    for (const int f : {e.face_1, e.face_2})
      if (text.empty() && f >= 0) text = brep.faces[std::size_t(f)].fault;
    return text;
  }

  void fault(const char* code, const std::string& field, const std::string& message, double measured = 0, double limit = 0,
             const char* unit = "") {
    item.part.out.fault(code, field, message, measured, limit, unit);
  }

  /// Takes an edge that was named by itself.
  void take(int index, const std::string& field) {
    const BrepEdge& e = brep.edges[std::size_t(index)];
    if (const std::string why = unread(index); !why.empty()) {
      fault("input.edge_unread", field,
            "found edge " + e.id + ", which the CAD reader could not read exactly (" + why +
                "); export the part again or choose other edges");
      return;
    }
    if (e.kind == EdgeKind::sharp_convex || (e.kind == EdgeKind::sharp_concave && !needs_convex)) {
      edges.insert(index);
      return;
    }
    fault("input.edge_not_sharp", field,
          fmt::format("found edge {} which is {} ({:.2f} degree between its faces), allowed a sharp {}edge of at least 10 degree", e.id,
                      name_of(e.kind), deg_from_rad(e.dihedral_rad), needs_convex ? "convex " : ""),
          deg_from_rad(e.dihedral_rad), 10, "degree");
  }

  /// An edge whose kind could not be told because something beside it was not read.
  bool is_hidden(int index) const {
    const EdgeKind k = brep.edges[std::size_t(index)].kind;
    return !unread(index).empty() && k != EdgeKind::smooth && k != EdgeKind::near_tangent && k != EdgeKind::sharp_concave;
  }

  void near(const Vec3& p, const std::string& field) {
    std::vector<std::pair<double, int>> order;
    for (std::size_t i = 0; i < brep.edges.size(); ++i)
      if ((is_sharp(brep.edges[i]) || !unread(int(i)).empty()) && !brep.edges[i].is_seam)
        order.emplace_back(distance_to(brep.edges[i], p), int(i));
    if (order.empty()) {
      fault("input.no_edge", field, "found no sharp edge in the part");
      return;
    }
    std::sort(order.begin(), order.end());
    const double limit = std::max(2.0, 0.05 * brep.box.diagonal_mm());
    const BrepEdge& best = brep.edges[std::size_t(order[0].second)];
    if (order[0].first > limit) {
      fault("input.edge_far", field,
            fmt::format("found the nearest sharp edge, {}, {:.2f} mm from {}, allowed within {:.2f} mm; is the point in the CAD's frame?",
                        best.id, order[0].first, text_of(p), limit),
            order[0].first, limit, "mm");
      return;
    }
    take(order[0].second, field);
    for (std::size_t k = 1; k < order.size() && order[k].first < order[0].first + 1e-3; ++k) {
      const BrepEdge& other = brep.edges[std::size_t(order[k].second)];
      if (runs_on(best, other)) {
        take(order[k].second, field);
      } else {
        fault("input.edge_ambiguous", field,
              fmt::format("found the edges {} and {} equally near to {}, allowed a point nearer to one: take one in the middle of the edge",
                          best.id, other.id, text_of(p)),
              order[k].first - order[0].first, 1e-3, "mm");
        return;
      }
    }
  }

  void of_face(const std::string& id, const std::string& field) {
    const auto face = std::find_if(brep.faces.begin(), brep.faces.end(), [&](const BrepFace& f) { return f.id == id; });
    if (face == brep.faces.end()) {
      fault("input.unknown_face", field, "found the face '" + shown(id) + "', allowed an id that `asbuilt cad --edges` prints");
      return;
    }
    std::size_t count = 0;
    for (const int e : face->edges)
      if (brep.edges[std::size_t(e)].kind == EdgeKind::sharp_convex || is_hidden(e)) take(e, field), ++count;
    if (count == 0) fault("input.no_edge", field, "found no sharp convex edge at face " + shown(id) + ", allowed a face with at least one");
  }
};

}  // namespace

std::vector<int> choose_edges(Item& item, const Brep& brep, const FeatureText& feature, const std::string& field, bool needs_convex) {
  Choice c{item, brep, feature.id, needs_convex, {}};
  const std::size_t before = item.part.out.faults.size();
  const EdgeChoiceText& t = feature.edges;
  const auto at = [&](const char* key, std::size_t i) { return field + "." + key + "[" + std::to_string(i) + "]"; };
  if (t.near_mm)
    for (std::size_t i = 0; i < t.near_mm->size(); ++i) c.near((*t.near_mm)[i], at("near", i));
  const auto edge_of = [&](const std::string& id, const std::string& place) {
    const auto e = std::find_if(brep.edges.begin(), brep.edges.end(), [&](const BrepEdge& x) { return x.id == id; });
    if (e != brep.edges.end()) return int(e - brep.edges.begin());
    c.fault("input.unknown_edge", place, "found the edge '" + shown(id) + "', allowed an id that `asbuilt cad --edges` prints");
    return -1;
  };
  if (t.step)
    for (std::size_t i = 0; i < t.step->size(); ++i)
      if (const int e = edge_of((*t.step)[i], at("step", i)); e >= 0) c.take(e, at("step", i));
  if (t.chain) {
    const std::vector<EdgeChain> chains = edge_chains(brep);
    for (std::size_t i = 0; i < t.chain->size(); ++i) {
      const int e = edge_of((*t.chain)[i], at("chain", i));
      if (e < 0) continue;
      const auto chain = std::find_if(chains.begin(), chains.end(),
                                      [&](const EdgeChain& x) { return std::find(x.edges.begin(), x.edges.end(), e) != x.edges.end(); });
      if (chain == chains.end())
        c.take(e, at("chain", i));  // not sharp: says so
      else
        for (const int k : chain->edges) c.take(k, at("chain", i));
    }
  }
  if (t.faces)
    for (std::size_t i = 0; i < t.faces->size(); ++i) c.of_face((*t.faces)[i], at("faces", i));
  if (t.sharp_convex) {
    Vec3 low = Vec3::Constant(-1e300), high = Vec3::Constant(1e300);
    if (t.sharp_convex->box_mm)
      low = (*t.sharp_convex->box_mm)[0].cwiseMin((*t.sharp_convex->box_mm)[1]),
      high = (*t.sharp_convex->box_mm)[0].cwiseMax((*t.sharp_convex->box_mm)[1]);
    low.array() -= 1e-6, high.array() += 1e-6;
    for (std::size_t i = 0; i < brep.edges.size(); ++i) {
      const BrepEdge& e = brep.edges[i];
      if ((e.kind != EdgeKind::sharp_convex && !c.is_hidden(int(i))) || e.p.empty()) continue;
      if (std::all_of(e.p.begin(), e.p.end(),
                      [&](const Vec3& p) { return (p.array() >= low.array()).all() && (p.array() <= high.array()).all(); }))
        c.take(int(i), field + ".sharp_convex");
    }
  }
  if (c.edges.empty() && item.part.out.faults.size() == before && (t.near_mm || t.step || t.chain || t.faces || t.sharp_convex))
    c.fault("input.no_edge", field,
            "found no sharp convex edge for feature '" + feature.id + "', allowed at least one; widen the box or name points on the edges");
  return {c.edges.begin(), c.edges.end()};
}

}  // namespace asbuilt::inputs
