// SPDX-License-Identifier: GPL-3.0-or-later
// A made file against its closed forms.
#pragma once

#include <gtest/gtest.h>

#include "independent.hpp"
#include "mesh_truth.hpp"
#include "planner/io/step/step_reader.hpp"
#include "variants.hpp"

namespace asbuilt::test {

inline void expect_truth(const std::string& text, const Truth& t, double relative = 2e-4) {
  StepOptions o;
  o.chord_mm = 0.01, o.angle_rad = 0.2;
  const auto r = read_step(text, "made.step", o);
  ASSERT_TRUE(r) << r.error()[0].code << " " << r.error()[0].message;
  const Brep& b = r->artefact;
  for (const Unread& u : b.unread) ADD_FAILURE() << u.why;
  for (const BrepFace& f : b.faces) EXPECT_EQ(f.fault, "") << f.id << " " << surface_type(f.surface);
  for (const BrepEdge& e : b.edges) EXPECT_EQ(e.fault, "") << e.id;
  EXPECT_EQ(static_cast<int>(b.faces.size()), t.faces);
  EXPECT_EQ(b.solids_count, t.solids);
  EXPECT_EQ(b.open_edges_count, 0);
  EXPECT_NEAR(b.volume_mm3, t.volume_mm3, relative * std::abs(t.volume_mm3));
  EXPECT_NEAR(b.area_mm2, t.area_mm2, relative * t.area_mm2);
  double convex = 0;
  for (const BrepEdge& e : b.edges)
    if (e.kind == EdgeKind::sharp_convex && !e.is_seam) convex += e.length_mm;
  EXPECT_NEAR(convex, t.convex_mm, 1e-3 * t.convex_mm + 1e-6);
  const TriangleSums m = triangle_sums(b.mesh);
  EXPECT_NEAR(m.volume_mm3.x(), t.volume_mm3, 0.02 * std::abs(t.volume_mm3));
  EXPECT_NEAR(m.area_mm2, t.area_mm2, 0.02 * t.area_mm2);
  const ChordCheck c = check_chords(b, 4, o.chord_mm, o.angle_rad);
  EXPECT_EQ(c.over, 0u) << c.face << " off by " << c.worst_mm;
  EXPECT_EQ(c.turns_over, 0u) << c.turn_face << " turns by " << c.worst_turn_rad;
}

}  // namespace asbuilt::test
