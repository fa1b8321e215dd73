// SPDX-License-Identifier: GPL-3.0-or-later
// Small STEP files written by the tests, with truth known by construction.
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "planner/base/frames.hpp"
#include "planner/base/number.hpp"

namespace asbuilt::test {

class StepText {
 public:
  int add(const std::string& entity) {
    lines_.push_back("#" + std::to_string(++last_) + "=" + entity + ";");
    return last_;
  }
  static std::string ref(int id) { return "#" + std::to_string(id); }
  static std::string list(const std::vector<int>& ids) {
    std::string s = "(";
    for (std::size_t k = 0; k < ids.size(); ++k) s += (k ? "," : "") + ref(ids[k]);
    return s + ")";
  }
  static std::string real(double v) {
    std::string s = shortest_number(v);
    return s.find_first_of(".e") == std::string::npos ? s + "." : s;
  }
  int point(const Vec3& p) { return add("CARTESIAN_POINT('',(" + real(p.x()) + "," + real(p.y()) + "," + real(p.z()) + "))"); }
  int direction(const Vec3& d) { return add("DIRECTION('',(" + real(d.x()) + "," + real(d.y()) + "," + real(d.z()) + "))"); }
  int axes(const Vec3& p, const Vec3& z, const Vec3& x) {
    const int a = point(p), b = direction(z), c = direction(x);
    return add("AXIS2_PLACEMENT_3D(''," + ref(a) + "," + ref(b) + "," + ref(c) + ")");
  }
  int vertex(const Vec3& p) { return add("VERTEX_POINT(''," + ref(point(p)) + ")"); }
  int edge(int v0, int v1, int curve, bool same_sense = true) {
    return add("EDGE_CURVE(''," + ref(v0) + "," + ref(v1) + "," + ref(curve) + (same_sense ? ",.T.)" : ",.F.)"));
  }
  int line(const Vec3& p, const Vec3& q) {
    const int a = point(p), d = direction((q - p).normalized());
    return add("LINE(''," + ref(a) + "," + ref(add("VECTOR(''," + ref(d) + ",1.)")) + ")");
  }
  int circle(const Vec3& p, const Vec3& z, const Vec3& x, double r) { return add("CIRCLE(''," + ref(axes(p, z, x)) + "," + real(r) + ")"); }
  /// uses: edge id, negative for against its direction
  int bound(const std::vector<int>& uses, bool orientation = true, bool is_outer = false) {
    std::vector<int> oriented;
    for (int u : uses) oriented.push_back(add("ORIENTED_EDGE('',*,*," + ref(std::abs(u)) + (u > 0 ? ",.T.)" : ",.F.)")));
    const int loop = add("EDGE_LOOP(''," + list(oriented) + ")");
    return add(std::string(is_outer ? "FACE_OUTER_BOUND" : "FACE_BOUND") + "(''," + ref(loop) + (orientation ? ",.T.)" : ",.F.)"));
  }
  int vertex_bound(int vertex) {
    const int loop = add("VERTEX_LOOP(''," + ref(vertex) + ")");
    return add("FACE_BOUND(''," + ref(loop) + ",.T.)");
  }
  int face(const std::vector<int>& bounds, int surface, bool same_sense = true) {
    return add("ADVANCED_FACE(''," + list(bounds) + "," + ref(surface) + (same_sense ? ",.T.)" : ",.F.)"));
  }
  int solid(const std::vector<int>& faces) {
    const int shell = add("CLOSED_SHELL(''," + list(faces) + ")");
    return add("MANIFOLD_SOLID_BREP(''," + ref(shell) + ")");
  }

  std::string length_unit = "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))";
  std::string angle_unit = "(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))";
  int context() {
    const int u = add(length_unit), a = add(angle_unit);
    return add("(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNIT_ASSIGNED_CONTEXT((" + ref(u) + "," + ref(a) +
               "))REPRESENTATION_CONTEXT('',''))");
  }
  /// Inch as files give it: a conversion based unit over millimetre.
  void use_inch() {
    const int mm = add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))");
    const int m = add("LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4)," + ref(mm) + ")");
    const int d = add("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)");
    length_unit = "(CONVERSION_BASED_UNIT('INCH'," + ref(m) + ")LENGTH_UNIT()NAMED_UNIT(" + ref(d) + "))";
  }
  void use_degrees() {
    const int r = add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))");
    const int m = add("PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE(0.0174532925199433)," + ref(r) + ")");
    const int d = add("DIMENSIONAL_EXPONENTS(0.,0.,0.,0.,0.,0.,0.)");
    angle_unit = "(CONVERSION_BASED_UNIT('DEGREE'," + ref(m) + ")NAMED_UNIT(" + ref(d) + ")PLANE_ANGLE_UNIT())";
  }
  int product(const std::string& name) {
    const int p = add("PRODUCT('" + name + "','" + name + "','',())");
    const int f = add("PRODUCT_DEFINITION_FORMATION('',''," + ref(p) + ")");
    return add("PRODUCT_DEFINITION('',''," + ref(f) + ",$)");
  }
  void define(int product_definition, int representation) {
    const int s = add("PRODUCT_DEFINITION_SHAPE('',''," + ref(product_definition) + ")");
    add("SHAPE_DEFINITION_REPRESENTATION(" + ref(s) + "," + ref(representation) + ")");
  }
  int representation(const std::vector<int>& items, int context_id, const std::string& kind = "ADVANCED_BREP_SHAPE_REPRESENTATION") {
    return add(kind + "(''," + list(items) + "," + ref(context_id) + ")");
  }
  /// One product with these items.
  void part(const std::vector<int>& items) { define(product("part"), representation(items, context())); }

  std::vector<std::string>& lines() { return lines_; }
  std::string text() const {
    std::string s =
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\nFILE_SCHEMA(('AUTOMOTIVE_DESIGN'));"
        "\nENDSEC;\nDATA;\n";
    for (const std::string& l : lines_) s += l + "\n";
    return s + "ENDSEC;\nEND-ISO-10303-21;\n";
  }

 private:
  std::vector<std::string> lines_;
  int last_ = 0;
};

/// Box from p to q; with `inside_out` every face points inwards.
inline int add_box(StepText& s, const Vec3& p, const Vec3& q, bool inside_out = false) {
  Vec3 c[8];
  int v[8];
  for (int k = 0; k < 8; ++k) c[k] = {k & 1 ? q.x() : p.x(), k & 2 ? q.y() : p.y(), k & 4 ? q.z() : p.z()}, v[k] = s.vertex(c[k]);
  std::map<std::pair<int, int>, int> edges;
  const auto use = [&](int a, int b) {
    const auto key = std::pair{std::min(a, b), std::max(a, b)};
    auto it = edges.find(key);
    if (it == edges.end()) it = edges.emplace(key, s.edge(v[key.first], v[key.second], s.line(c[key.first], c[key.second]))).first;
    return a < b ? it->second : -it->second;
  };
  const int quads[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  std::vector<int> faces;
  for (const auto& f : quads) {
    const Vec3 n = (c[f[1]] - c[f[0]]).cross(c[f[2]] - c[f[1]]).normalized();
    const int plane = s.add("PLANE(''," + StepText::ref(s.axes(c[f[0]], n, (c[f[1]] - c[f[0]]).normalized())) + ")");
    std::vector<int> uses;
    for (int k = 0; k < 4; ++k) uses.push_back(use(f[k], f[(k + 1) % 4]));
    faces.push_back(s.face({s.bound(uses, !inside_out, true)}, plane, !inside_out));
  }
  return s.solid(faces);
}

/// Cylinder along z without a seam: the side has two bounds of one closed edge each.
inline int add_seamless_cylinder(StepText& s, double r, double h) {
  const int v0 = s.vertex({r, 0, 0}), v1 = s.vertex({r, 0, h});
  const int e0 = s.edge(v0, v0, s.circle({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX(), r)),
            e1 = s.edge(v1, v1, s.circle({0, 0, h}, Vec3::UnitZ(), Vec3::UnitX(), r));
  const int side =
      s.add("CYLINDRICAL_SURFACE(''," + StepText::ref(s.axes({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX())) + "," + StepText::real(r) + ")");
  const int low = s.add("PLANE(''," + StepText::ref(s.axes({0, 0, 0}, -Vec3::UnitZ(), Vec3::UnitX())) + ")");
  const int high = s.add("PLANE(''," + StepText::ref(s.axes({0, 0, h}, Vec3::UnitZ(), Vec3::UnitX())) + ")");
  return s.solid({s.face({s.bound({e0}), s.bound({-e1})}, side), s.face({s.bound({-e0})}, low), s.face({s.bound({e1})}, high)});
}

}  // namespace asbuilt::test
