// SPDX-License-Identifier: GPL-3.0-or-later
// What a part comes to, whatever way it is written.
#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "planner/io/step/step_reader.hpp"
#include "rewrite.hpp"

namespace asbuilt::test {

struct PartSums {
  std::string refused;  // code
  int solids = 0, shells = 0, open_edges = 0;
  double area = 0, volume = 0, convex = 0, diagonal = 0;
  std::map<std::string, int> faces;  // by surface
  std::size_t faults = 0, unread = 0;
};

/// Lengths divided by `scale`.
inline PartSums part_sums(const std::string& text, double scale) {
  PartSums out;
  StepOptions o;
  o.want_mesh = false;
  const auto outline = read_step(text, "x", o);
  if (!outline) {
    out.refused = outline.error()[0].code;
    return out;
  }
  o.want_mesh = true, o.chord_mm = std::clamp(1e-4 * outline->artefact.box.diagonal_mm() / scale, 1e-3, 0.02) * scale;
  o.edge_step_mm = scale;
  const auto r = read_step(text, "x", o);
  if (!r) {
    out.refused = r.error()[0].code;
    return out;
  }
  const Brep& b = r->artefact;
  out.solids = b.solids_count, out.shells = b.shells_count, out.open_edges = b.solids_count > 0 ? b.open_edges_count : 0;
  out.area = b.area_mm2 / (scale * scale), out.volume = b.volume_mm3 / (scale * scale * scale);
  for (const BrepFace& f : b.faces) ++out.faces[std::string(surface_type(f.surface))], out.faults += !f.fault.empty();
  for (const BrepEdge& e : b.edges)
    if (e.kind == EdgeKind::sharp_convex && !e.is_seam) out.convex += e.length_mm / scale;
  out.unread = b.unread.size();
  return out;
}

inline double relative(double a, double b) { return std::abs(a - b) / std::max(std::abs(b), 1e-9); }

inline std::string difference_of(const PartSums& a, const PartSums& b) {
  std::string s;
  const auto say = [&](const std::string& what, double x, double y) {
    s += " " + what + " " + shortest_number(x) + " -> " + shortest_number(y);
  };
  if (a.refused != b.refused) return " refused '" + a.refused + "' -> '" + b.refused + "'";
  if (a.faces != b.faces) s += " faces";
  if (a.solids != b.solids) say("solids", a.solids, b.solids);
  if (a.shells != b.shells) say("shells", a.shells, b.shells);
  if (a.open_edges != b.open_edges) say("open", a.open_edges, b.open_edges);
  if (a.faults != b.faults) say("faults", static_cast<double>(a.faults), static_cast<double>(b.faults));
  if (a.unread != b.unread) say("unread", static_cast<double>(a.unread), static_cast<double>(b.unread));
  if (relative(b.area, a.area) > 2e-5) say("area", a.area, b.area);
  if (a.solids > 0 && relative(b.volume, a.volume) > 1e-4) say("volume", a.volume, b.volume);
  if (relative(b.convex, a.convex) > 1e-4 && std::abs(a.convex - b.convex) > 1e-3) say("convex", a.convex, b.convex);
  return s;
}

}  // namespace asbuilt::test
