// SPDX-License-Identifier: GPL-3.0-or-later
// Boxes and prisms in the ways they are written: facets, splines, polylines, curved walls; holes, tiny edges; bodies given as triangles.
#include <gtest/gtest.h>

#include "variants.hpp"
#include "variants_check.hpp"

namespace asbuilt {
namespace {

using test::StepText;
using test::Truth;
using test::Variant;

const Vec3 kX = Vec3::UnitX(), kY = Vec3::UnitY(), kZ = Vec3::UnitZ();

class Flat : public testing::TestWithParam<Variant> {};
TEST_P(Flat, HasTheTruth) {
  StepText s;
  const Truth t = GetParam().make(s);
  test::expect_truth(s.text(), t);
}

/// One side of a prism profile: from its point to the next, as a curve at height z and a wall surface (0: a plane).
struct Side {
  Vec2 from;
  std::function<int(StepText&, double z)> curve;  // empty: a line
  std::function<int(StepText&)> wall;
  bool same_sense = true;
};
Vec3 at(const Vec2& p, double z) { return {p.x(), p.y(), z}; }

/// Counter-clockwise sides of the outer profile, clockwise ones of holes.
void add_prism(StepText& s, const std::vector<std::vector<Side>>& profiles, double h, int* solid_out = nullptr) {
  std::vector<int> faces, bottom, top;
  for (const auto& sides : profiles) {
    const std::size_t n = sides.size();
    std::vector<int> v0, v1, low, high, up;
    for (const Side& q : sides) v0.push_back(s.vertex(at(q.from, 0))), v1.push_back(s.vertex(at(q.from, h)));
    for (std::size_t k = 0; k < n; ++k) {
      const Side& q = sides[k];
      const Vec2& next = sides[(k + 1) % n].from;
      const auto curve = [&](double z) { return q.curve ? q.curve(s, z) : s.line(at(q.from, z), at(next, z)); };
      low.push_back(s.edge(v0[k], v0[(k + 1) % n], curve(0))), high.push_back(s.edge(v1[k], v1[(k + 1) % n], curve(h)));
      up.push_back(s.edge(v0[k], v1[k], s.line(at(q.from, 0), at(q.from, h))));
    }
    for (std::size_t k = 0; k < n; ++k) {
      const Side& q = sides[k];
      const Vec2 d = sides[(k + 1) % n].from - q.from;
      const int wall =
          q.wall ? q.wall(s) : s.add("PLANE(''," + s.ref(s.axes(at(q.from, 0), Vec3(d.y(), -d.x(), 0).normalized(), kZ)) + ")");
      const std::vector<int> loop =
          n == 1 ? std::vector<int>{low[0], up[0], -high[0], -up[0]} : std::vector<int>{low[k], up[(k + 1) % n], -high[k], -up[k]};
      faces.push_back(s.face({s.bound(loop, true, true)}, wall, q.same_sense));
    }
    std::vector<int> back;
    for (std::size_t k = n; k-- > 0;) back.push_back(-low[k]);
    bottom.push_back(s.bound(back)), top.push_back(s.bound(high));
  }
  faces.push_back(s.face(bottom, s.add("PLANE(''," + s.ref(s.axes({0, 0, 0}, -kZ, kX)) + ")")));
  faces.push_back(s.face(top, s.add("PLANE(''," + s.ref(s.axes({0, 0, h}, kZ, kX)) + ")")));
  const int solid = s.solid(faces);
  if (solid_out)
    *solid_out = solid;
  else
    s.part({solid});
}

int extruded(StepText& s, int curve) {
  return s.add("SURFACE_OF_LINEAR_EXTRUSION(''," + s.ref(curve) + "," + s.ref(s.add("VECTOR(''," + s.ref(s.direction(kZ)) + ",1.)")) + ")");
}

Truth faceted_box(StepText& s, const std::string& entity) {
  Vec3 c[8];
  int p[8];
  for (int k = 0; k < 8; ++k) c[k] = {k & 1 ? 30. : 0., k & 2 ? 20. : 0., k & 4 ? 10. : 0.}, p[k] = s.point(c[k]);
  const int quads[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  std::vector<int> faces;
  for (const auto& f : quads) {
    const Vec3 n = (c[f[1]] - c[f[0]]).cross(c[f[2]] - c[f[1]]).normalized();
    const int loop = s.add("POLY_LOOP(''," + s.list({p[f[0]], p[f[1]], p[f[2]], p[f[3]]}) + ")");
    const int bound = s.add("FACE_OUTER_BOUND(''," + s.ref(loop) + ",.T.)");
    faces.push_back(s.add("FACE_SURFACE(''," + s.list({bound}) + "," +
                          s.ref(s.add("PLANE(''," + s.ref(s.axes(c[f[0]], n, (c[f[1]] - c[f[0]]).normalized())) + ")")) + ",.T.)"));
  }
  const int shell = s.add("CLOSED_SHELL(''," + s.list(faces) + ")"), body = s.add(entity + "(''," + s.ref(shell) + ")");
  s.define(s.product("f"), s.representation({body}, s.context(), "FACETED_BREP_SHAPE_REPRESENTATION"));
  return {6000, 2200, 240, 6, 1};
}

/// Box whose long front edge and front wall are a spline, a polyline or made of pieces.
Truth box_with_front(StepText& s, const std::string& how) {
  Side front{{0, 0}, {}, {}, true};
  const auto bilinear = [](StepText& q) {
    return test::spline_surface(q, 1, 1, {{{0, 0, 0}, {0, 0, 10}}, {{30, 0, 0}, {30, 0, 10}}}, {}, {2, 2}, {2, 2}, {0, 1}, {0, 1});
  };
  if (how == "bilinear wall") front.wall = bilinear;
  for (const std::string kind : {"BEZIER", "UNIFORM", "QUASI_UNIFORM"})
    if (how == kind + " wall")
      front.wall = [kind](StepText& q) {
        return q.add(kind + "_SURFACE('',1,1," + test::rows(q, {{{0, 0, 0}, {0, 0, 10}}, {{30, 0, 0}, {30, 0, 10}}}) +
                     ",.UNSPECIFIED.,.F.,.F.,.U.)");
      };
  if (how == "cubic edge")
    front.curve = [](StepText& q, double z) {
      return test::spline_curve(q, 3, {{0, 0, z}, {3, 0, z}, {11, 0, z}, {30, 0, z}}, {4, 4}, {-5, 7});
    };
  if (how == "unclamped edge")
    front.curve = [](StepText& q, double z) {
      return test::spline_curve(q, 2, {{-10, 0, z}, {10, 0, z}, {20, 0, z}, {50, 0, z}}, {1, 1, 1, 1, 1, 1, 1}, {0, 1, 2, 3, 4, 5, 6});
    };
  if (how == "polyline edge")
    front.curve = [](StepText& q, double z) {
      return q.add("POLYLINE(''," + q.list(test::points(q, {{0, 0, z}, {7, 0, z}, {30, 0, z}})) + ")");
    };
  if (how == "quasi uniform edge")
    front.curve = [](StepText& q, double z) {
      return q.add("QUASI_UNIFORM_CURVE('',2," + q.list(test::points(q, {{0, 0, z}, {4, 0, z}, {9, 0, z}, {30, 0, z}})) +
                   ",.UNSPECIFIED.,.F.,.F.)");
    };
  if (how == "bezier edge")
    front.curve = [](StepText& q, double z) {
      return q.add("BEZIER_CURVE('',3," + q.list(test::points(q, {{0, 0, z}, {4, 0, z}, {9, 0, z}, {30, 0, z}})) +
                   ",.UNSPECIFIED.,.F.,.F.)");
    };
  if (how == "offset edge")
    front.curve = [](StepText& q, double z) {
      return q.add("OFFSET_CURVE_3D(''," + q.ref(q.line({0, -4, z}, {30, -4, z})) + ",4.,.F.," + q.ref(q.direction(kZ)) + ")");
    };
  if (how == "offset spline edge")
    front.curve = [](StepText& q, double z) {
      return q.add("OFFSET_CURVE_3D(''," + q.ref(test::spline_curve(q, 3, {{0, 5, z}, {8, 5, z}, {22, 5, z}, {30, 5, z}}, {4, 4}, {0, 1})) +
                   ",-5.,.F.," + q.ref(q.direction(kZ)) + ")");
    };
  if (how == "composite edge")
    front.curve = [](StepText& q, double z) {
      const auto piece = [&](double a, double b) {
        const int t =
            q.add("TRIMMED_CURVE(''," + q.ref(q.line({a, 0, z}, {b, 0, z})) + ",(" + q.ref(q.point({a, 0, z})) + ",PARAMETER_VALUE(0.)),(" +
                  q.ref(q.point({b, 0, z})) + ",PARAMETER_VALUE(" + q.real(b - a) + ")),.T.,.CARTESIAN.)");
        return q.add("COMPOSITE_CURVE_SEGMENT(.CONTINUOUS.,.T.," + q.ref(t) + ")");
      };
      return q.add("COMPOSITE_CURVE(''," + q.list({piece(0, 12), piece(12, 30)}) + ",.U.)");
    };
  if (how == "long vector")
    front.curve = [](StepText& q, double z) {
      return q.add("LINE(''," + q.ref(q.point({-4, 0, z})) + "," +
                   q.ref(q.add("VECTOR(''," + q.ref(q.direction({250, 0, 0})) + ",1000.)")) + ")");
    };
  add_prism(s, {{front, {{30, 0}, {}, {}}, {{30, 20}, {}, {}}, {{0, 20}, {}, {}}}}, 10);
  return {6000, 2200, 240, 6, 1};
}

/// Half disc of radius 10 closed by a straight side: the round wall in its writings.
Truth half_disc(StepText& s, const std::string& how) {
  Side round{{10, 0}, {}, {}, true};
  const auto arc = [](StepText& q, double z) { return q.circle({0, 0, z}, kZ, kX, 10); };
  round.curve = arc;
  round.wall = [](StepText& q) { return q.add("CYLINDRICAL_SURFACE(''," + q.ref(q.axes({0, 0, 0}, kZ, kX)) + ",10.)"); };
  if (how == "extruded circle") round.wall = [arc](StepText& q) { return extruded(q, arc(q, 0)); };
  if (how == "extruded trimmed arc")
    round.wall = [arc](StepText& q) {
      return extruded(
          q, q.add("TRIMMED_CURVE(''," + q.ref(arc(q, 0)) + ",(PARAMETER_VALUE(0.)),(PARAMETER_VALUE(3.14159265358979)),.T.,.PARAMETER.)"));
    };
  if (how == "extruded arc trimmed backwards") {
    round.same_sense = false;
    round.wall = [arc](StepText& q) {
      return extruded(
          q, q.add("TRIMMED_CURVE(''," + q.ref(arc(q, 0)) + ",(PARAMETER_VALUE(3.14159265358979)),(PARAMETER_VALUE(0.)),.F.,.PARAMETER.)"));
    };
  }
  if (how == "extruded spline") {
    const double w = std::sqrt(0.5);
    const auto spline = [w](StepText& q, double z) {
      return test::rational_curve(q, 2, {{10, 0, z}, {10, 10, z}, {0, 10, z}, {-10, 10, z}, {-10, 0, z}}, {1, w, 1, w, 1}, {3, 2, 3},
                                  {0, 1, 2});
    };
    round.curve = spline, round.wall = [spline](StepText& q) { return extruded(q, spline(q, 0)); };
  }
  add_prism(s, {{round, {{-10, 0}, {}, {}}}}, 7);
  return {50 * kPi * 7, 100 * kPi + 7 * (10 * kPi + 20), 2 * (10 * kPi + 20) + 14, 4, 1};
}

Truth ellipse_prism(StepText& s, bool spline) {
  const auto rim = [](StepText& q, double z) { return q.add("ELLIPSE(''," + q.ref(q.axes({0, 0, z}, kZ, kX)) + ",12.,5.)"); };
  Side round{{12, 0}, rim, [&](StepText& q) { return extruded(q, rim(q, 0)); }, true};
  if (spline) {
    const auto poles = [](double z) {
      auto p = test::circle_poles({0, 0, z}, 12 * kX, 5 * kY, 1);
      return p;
    };
    round.wall = [poles](StepText& q) {
      std::vector<std::vector<Vec3>> p;
      std::vector<std::vector<double>> w;
      for (std::size_t k = 0; k < 9; ++k)
        p.push_back({poles(0)[k], poles(6)[k]}), w.push_back({test::circle_weights()[k], test::circle_weights()[k]});
      return test::spline_surface(q, 2, 1, p, w, {3, 2, 2, 2, 3}, {2, 2}, {0, 1, 2, 3, 4}, {0, 1});
    };
  }
  add_prism(s, {{round}}, 6);
  double length = 0;  // of the ellipse, by the trapezoidal rule (exact to rounding for a periodic integrand)
  for (int k = 0; k < 400; ++k) length += std::hypot(12 * std::sin(2 * kPi * k / 400), 5 * std::cos(2 * kPi * k / 400)) * 2 * kPi / 400;
  return {60 * kPi * 6, 120 * kPi + 6 * length, 2 * length, 3, 1};
}

/// Under y = 9 - x^2 / 4 (parabola) or a branch of a hyperbola, closed by the straight side y = 0.
Truth conic_prism(StepText& s, bool is_parabola) {
  double area = 0, length = 0;
  Side curved{{6, 0}, {}, {}, true};
  std::function<int(StepText&, double)> c;
  std::function<double(double)> y, dy;
  if (is_parabola) {  // focal distance 1, vertex (0, 9), axis down
    c = [](StepText& q, double z) { return q.add("PARABOLA(''," + q.ref(q.axes({0, 9, z}, -kZ, -kY)) + ",1.)"); };
    y = [](double x) { return 9 - x * x / 4; }, dy = [](double x) { return -x / 2; };
  } else {  // y = 10 - sqrt(16 + x^2 * 16 / 12 ...): a = 4 along -y, through (6, 0): 100 / 16 - 36 / b^2 = 1
    const double b2 = 36 / (100.0 / 16 - 1);
    c = [b2](StepText& q, double z) {
      return q.add("HYPERBOLA(''," + q.ref(q.axes({0, 10, z}, -kZ, -kY)) + ",4.," + q.real(std::sqrt(b2)) + ")");
    };
    y = [b2](double x) { return 10 - 4 * std::sqrt(1 + x * x / b2); },
    dy = [b2](double x) { return -4 * x / b2 / std::sqrt(1 + x * x / b2); };
  }
  curved.curve = c;
  curved.wall = [c](StepText& q) { return extruded(q, c(q, 0)); };
  constexpr int n = 20000;
  for (int k = 0; k < n; ++k) {
    const double x = -6 + 12 * (k + 0.5) / n;
    area += y(x) * 12 / n, length += std::hypot(1, dy(x)) * 12 / n;
  }
  add_prism(s, {{curved, {{-6, 0}, {}, {}}}}, 5);
  return {area * 5, 2 * area + 5 * (length + 12), 2 * (length + 12) + 10, 4, 1};
}

Truth plate_with_hole(StepText& s, int holes, double r) {
  std::vector<std::vector<Side>> profiles;
  for (int k = 0; k < holes; ++k) {  // holes first: the order of bounds must not matter
    const Vec3 c(8 + 9 * k, 10, 0);
    Side side{{c.x() + r, c.y()},
              [c, r](StepText& q, double z) { return q.circle(c + z * kZ, -kZ, kX, r); },
              [c, r](StepText& q) { return q.add("CYLINDRICAL_SURFACE(''," + q.ref(q.axes(c, kZ, kX)) + "," + q.real(r) + ")"); },
              false};
    profiles.push_back({side});
  }
  profiles.push_back({{{0, 0}, {}, {}}, {{40, 0}, {}, {}}, {{40, 20}, {}, {}}, {{0, 20}, {}, {}}});
  add_prism(s, profiles, 5);
  const double hole = kPi * r * r;
  return {(800 - holes * hole) * 5, 2 * (800 - holes * hole) + 5 * (120 + holes * 2 * kPi * r), 2 * 120 + 20 + holes * 4 * kPi * r,
          6 + holes, 1};
}

Truth tiny_edges(StepText& s, double tiny) {  // a corner cut off by next to nothing
  add_prism(s, {{{{0, 0}, {}, {}}, {{30, 0}, {}, {}}, {{30, 20 - tiny}, {}, {}}, {{30 - tiny, 20}, {}, {}}, {{0, 20}, {}, {}}}}, 10);
  const double area = 600 - tiny * tiny / 2, rim = 100 - 2 * tiny + std::sqrt(2) * tiny;
  return {area * 10, 2 * area + 10 * rim, 2 * rim + 50, 7, 1};
}

Truth triangles(StepText& s, const std::string& how) {
  const double mm = how.find("inch") != std::string::npos ? 25.4 : 1;
  if (mm != 1) s.use_inch();
  std::string list;
  for (int k = 0; k < 8; ++k)
    list += std::string(k ? "," : "") + test::reals({(k & 1 ? 30. : 0.) / mm, (k & 2 ? 20. : 0.) / mm, (k & 4 ? 10. : 0.) / mm});
  const int coordinates = s.add("COORDINATES_LIST('',8,(" + list + "))");
  const int quads[6][4] = {{1, 3, 4, 2}, {5, 6, 8, 7}, {1, 2, 6, 5}, {3, 7, 8, 4}, {1, 5, 7, 3}, {2, 4, 8, 6}};
  std::vector<int> faces;
  std::string all;
  for (const auto& q : quads) {
    const std::string own = test::integers({q[0], q[1], q[2], q[3]});
    if (how.find("strips") != std::string::npos)
      faces.push_back(s.add("COMPLEX_TRIANGULATED_FACE(''," + s.ref(coordinates) + ",4,((0.,0.,1.)),$," + own + ",((1,2,4,3)),())"));
    else if (how.find("fans") != std::string::npos)
      faces.push_back(s.add("COMPLEX_TRIANGULATED_FACE(''," + s.ref(coordinates) + ",8,(),$,(),(),(" + own + "))"));
    else if (how.find("own index") != std::string::npos)
      faces.push_back(s.add("TRIANGULATED_FACE(''," + s.ref(coordinates) + ",4,(),$," + own + ",((1,2,3),(1,3,4)))"));
    else
      faces.push_back(s.add("TRIANGULATED_FACE(''," + s.ref(coordinates) + ",8,(),$,(),(" + test::integers({q[0], q[1], q[2]}) + "," +
                            test::integers({q[0], q[2], q[3]}) + "))"));
  }
  const int solid = how.find("shell") != std::string::npos ? s.add("TESSELLATED_SHELL(''," + s.list(faces) + ",$)")
                                                           : s.add("TESSELLATED_SOLID(''," + s.list(faces) + ",$)");
  s.define(s.product("t"), s.representation({solid}, s.context(), "TESSELLATED_SHAPE_REPRESENTATION"));
  return {6000, 2200, 240, 6, 1};
}

std::vector<Variant> flat() {
  std::vector<Variant> all;
  all.push_back({"faceted brep", [](StepText& s) { return faceted_box(s, "FACETED_BREP"); }});
  all.push_back({"poly loops in a manifold brep", [](StepText& s) { return faceted_box(s, "MANIFOLD_SOLID_BREP"); }});
  for (const std::string how :
       {"bilinear wall", "BEZIER wall", "UNIFORM wall", "QUASI_UNIFORM wall", "cubic edge", "unclamped edge", "polyline edge",
        "quasi uniform edge", "bezier edge", "offset edge", "offset spline edge", "composite edge", "long vector"})
    all.push_back({how, [how](StepText& s) { return box_with_front(s, how); }});
  for (const std::string how : {"cylinder", "extruded circle", "extruded trimmed arc", "extruded arc trimmed backwards", "extruded spline"})
    all.push_back({"half disc " + how, [how](StepText& s) { return half_disc(s, how); }});
  all.push_back({"ellipse extruded", [](StepText& s) { return ellipse_prism(s, false); }});
  all.push_back({"ellipse by a rational wall", [](StepText& s) { return ellipse_prism(s, true); }});
  all.push_back({"parabola", [](StepText& s) { return conic_prism(s, true); }});
  all.push_back({"hyperbola", [](StepText& s) { return conic_prism(s, false); }});
  all.push_back({"one hole", [](StepText& s) { return plate_with_hole(s, 1, 3); }});
  all.push_back({"three holes", [](StepText& s) { return plate_with_hole(s, 3, 3); }});
  all.push_back({"holes a hair apart", [](StepText& s) { return plate_with_hole(s, 3, 4.49); }});
  for (const double tiny : {1e-3, 1e-5, 1e-7})
    all.push_back({"tiny edge " + StepText::real(tiny), [tiny](StepText& s) { return tiny_edges(s, tiny); }});
  for (const std::string how : {"plain", "own index", "strips", "fans", "plain inch", "plain shell"})
    all.push_back({"triangles " + how, [how](StepText& s) { return triangles(s, how); }});
  return all;
}
// Every edge brings vertices of its own, at the places of its neighbours'.
TEST(Contradictions, VerticesThatAreNotShared) {
  StepText s;
  s.part({test::add_box(s, {0, 0, 0}, {30, 20, 10})});
  std::string text = s.text();
  int fresh = 100000;
  for (std::size_t at = text.find("EDGE_CURVE(''"); at != std::string::npos; at = text.find("EDGE_CURVE(''", at + 1))
    for (int k = 0; k < 2; ++k) {
      std::size_t from = text.find('#', at);
      if (k) from = text.find('#', from + 1);
      const std::size_t to = text.find(',', from);
      const std::string old = text.substr(from, to - from), entity = "\n" + old + "=VERTEX_POINT('',";
      const std::size_t point = text.find('#', text.find(entity) + entity.size() - 1);
      const std::string p = text.substr(point, text.find(')', point) - point);
      text.replace(from, to - from, "#" + std::to_string(++fresh));
      text.insert(text.rfind("ENDSEC;"), "#" + std::to_string(fresh) + "=VERTEX_POINT(''," + p + ");\n");
    }
  test::expect_truth(text, {6000, 2200, 240, 6, 1});
}

// A face whose sense contradicts its loop, while its loop agrees with its neighbours: the loop rules. A loop that runs against all its
// neighbours: the sense rules.
TEST(Contradictions, SensesAndLoopsThatContradictEachOther) {
  for (const bool wrong_sense : {true, false})
    for (int which = 0; which < 6; ++which) {
      StepText s;
      s.part({test::add_box(s, {0, 0, 0}, {30, 20, 10})});
      std::string text = s.text();
      std::size_t at = 0;
      for (int k = 0; k <= which; ++k) at = text.find(wrong_sense ? "ADVANCED_FACE" : "FACE_OUTER_BOUND", at) + 1;
      text.replace(text.find(",.T.)", at), 5, ",.F.)");
      SCOPED_TRACE(std::to_string(which) + (wrong_sense ? " sense" : " loop"));
      test::expect_truth(text, {6000, 2200, 240, 6, 1});
    }
}

INSTANTIATE_TEST_SUITE_P(All, Flat, testing::ValuesIn(flat()), [](const auto& p) { return test::name_of_variant(p.param.name); });

}  // namespace
}  // namespace asbuilt
