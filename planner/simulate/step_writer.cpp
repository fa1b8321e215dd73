// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/simulate/step_writer.hpp"

#include <fmt/format.h>

#include "planner/base/number.hpp"

namespace asbuilt::simulate_detail {
namespace {

std::string real(double v) {
  std::string t = shortest_number(rounded(v, 9));
  const std::size_t e = t.find('e');
  if (t.find('.') == std::string::npos) t.insert(e == std::string::npos ? t.size() : e, ".");
  for (char& c : t)
    if (c == 'e') c = 'E';
  return t;
}
std::string triple(const Vec3& p) { return real(p.x()) + "," + real(p.y()) + "," + real(p.z()); }

// Of a clamped uniform cubic with `count` poles.
std::string multiplicities(int count) {
  std::string t = "(4";
  for (int i = 1; i < count - 3; ++i) t += ",1";
  return t + ",4)";
}
std::string knots(int count) {
  std::string t = "(0.";
  for (int i = 1; i < count - 3; ++i) t += "," + real(static_cast<double>(i) / (count - 3));
  return t + ",1.)";
}

}  // namespace

int StepWriter::add(const std::string& text) {
  body_ += fmt::format("#{}={};\n", ++last_, text);
  return last_;
}
int StepWriter::point(const Vec3& p) { return add(fmt::format("CARTESIAN_POINT('',({}))", triple(p))); }
int StepWriter::direction(const Vec3& d) { return add(fmt::format("DIRECTION('',({}))", triple(d))); }
int StepWriter::placement(const Vec3& o, const Vec3& z, const Vec3& x) {
  const int a = point(o), b = direction(z), c = direction(x);
  return add(fmt::format("AXIS2_PLACEMENT_3D('',#{},#{},#{})", a, b, c));
}
int StepWriter::vertex(const Vec3& p) {
  const std::string key = triple(p);
  auto [it, fresh] = vertices_.try_emplace(key, 0);
  if (fresh) {
    const int c = point(p);
    it->second = add(fmt::format("VERTEX_POINT('',#{})", c));
  }
  return it->second;
}
int StepWriter::line_edge(const Vec3& a, const Vec3& b) {
  const int va = vertex(a), vb = vertex(b), o = point(a), d = direction((b - a).normalized());
  const int v = add(fmt::format("VECTOR('',#{},1.)", d));
  const int l = add(fmt::format("LINE('',#{},#{})", o, v));
  return add(fmt::format("EDGE_CURVE('',#{},#{},#{},.T.)", va, vb, l));
}
int StepWriter::circle_edge(const Vec3& center, const Vec3& up, double radius, const Vec3& a, const Vec3& b) {
  const int va = vertex(a), vb = vertex(b), p = placement(center, up, (a - center).normalized());
  const int c = add(fmt::format("CIRCLE('',#{},{})", p, real(radius)));
  return add(fmt::format("EDGE_CURVE('',#{},#{},#{},.T.)", va, vb, c));
}
int StepWriter::spline_edge(const std::vector<Vec3>& poles) {
  const int va = vertex(poles.front()), vb = vertex(poles.back());
  std::string list;
  for (const Vec3& p : poles) list += fmt::format("{}#{}", list.empty() ? "" : ",", point(p));
  const int n = static_cast<int>(poles.size());
  const int c = add(fmt::format("B_SPLINE_CURVE_WITH_KNOTS('',3,({}),.UNSPECIFIED.,.F.,.F.,{},{},.UNSPECIFIED.)", list, multiplicities(n), knots(n)));
  return add(fmt::format("EDGE_CURVE('',#{},#{},#{},.T.)", va, vb, c));
}
int StepWriter::loop(const std::vector<std::pair<int, bool>>& edges) {
  std::string list;
  for (const auto& [e, forward] : edges) {
    const int o = add(fmt::format("ORIENTED_EDGE('',*,*,#{},.{}.)", e, forward ? 'T' : 'F'));
    list += fmt::format("{}#{}", list.empty() ? "" : ",", o);
  }
  return add(fmt::format("EDGE_LOOP('',({}))", list));
}
void StepWriter::face(int surface, bool same_sense, const std::vector<int>& loops) {
  std::string list;
  for (std::size_t i = 0; i < loops.size(); ++i) {
    const int b = add(fmt::format("{}('',#{},.T.)", i == 0 ? "FACE_OUTER_BOUND" : "FACE_BOUND", loops[i]));
    list += fmt::format("{}#{}", list.empty() ? "" : ",", b);
  }
  faces_.push_back(add(fmt::format("ADVANCED_FACE('',({}),#{},.{}.)", list, surface, same_sense ? 'T' : 'F')));
}
int StepWriter::plane(const Vec3& o, const Vec3& n) {
  return add(fmt::format("PLANE('',#{})", placement(o, n, std::abs(n.z()) > 0.9 ? Vec3::UnitX() : Vec3::UnitZ())));
}
int StepWriter::cylinder(const Vec3& o, const Vec3& axis, double radius) {
  return add(fmt::format("CYLINDRICAL_SURFACE('',#{},{})", placement(o, axis, std::abs(axis.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitZ()), real(radius)));
}
int StepWriter::cone(const Vec3& o, const Vec3& axis, double radius, double half_angle_rad) {
  return add(fmt::format("CONICAL_SURFACE('',#{},{},{})", placement(o, axis, Vec3::UnitX()), real(radius), real(half_angle_rad)));
}
int StepWriter::torus(const Vec3& o, const Vec3& axis, double major, double minor) {
  return add(fmt::format("TOROIDAL_SURFACE('',#{},{},{})", placement(o, axis, Vec3::UnitX()), real(major), real(minor)));
}
int StepWriter::spline_surface(const std::vector<std::vector<Vec3>>& poles) {
  std::string rows;
  for (const auto& row : poles) {
    std::string list;
    for (const Vec3& p : row) list += fmt::format("{}#{}", list.empty() ? "" : ",", point(p));
    rows += fmt::format("{}({})", rows.empty() ? "" : ",", list);
  }
  const int nu = static_cast<int>(poles.size()), nv = static_cast<int>(poles[0].size());
  return add(fmt::format("B_SPLINE_SURFACE_WITH_KNOTS('',3,3,({}),.UNSPECIFIED.,.F.,.F.,.F.,{},{},{},{},.UNSPECIFIED.)", rows, multiplicities(nu),
                         multiplicities(nv), knots(nu), knots(nv)));
}
std::string StepWriter::finish(const std::string& name) {
  std::string list;
  for (int f : faces_) list += fmt::format("{}#{}", list.empty() ? "" : ",", f);
  const int shell = add(fmt::format("CLOSED_SHELL('',({}))", list));
  const int solid = add(fmt::format("MANIFOLD_SOLID_BREP('{}',#{})", name, shell));
  const int mm = add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))");
  const int rad = add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))");
  const int sr = add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())");
  const int unc = add(fmt::format("UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-05),#{},'distance_accuracy_value','')", mm));
  const int context = add(fmt::format(
      "(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#{}))GLOBAL_UNIT_ASSIGNED_CONTEXT((#{},#{},#{}))"
      "REPRESENTATION_CONTEXT('',''))",
      unc, mm, rad, sr));
  const int world = placement(Vec3::Zero(), Vec3::UnitZ(), Vec3::UnitX());
  const int rep = add(fmt::format("ADVANCED_BREP_SHAPE_REPRESENTATION('',(#{},#{}),#{})", world, solid, context));
  const int app = add("APPLICATION_CONTEXT('automotive design')");
  const int pc = add(fmt::format("PRODUCT_CONTEXT('',#{},'mechanical')", app));
  const int product = add(fmt::format("PRODUCT('{0}','{0}','',(#{1}))", name, pc));
  const int formation = add(fmt::format("PRODUCT_DEFINITION_FORMATION('','',#{})", product));
  const int pdc = add(fmt::format("PRODUCT_DEFINITION_CONTEXT('part definition',#{},'design')", app));
  const int definition = add(fmt::format("PRODUCT_DEFINITION('design','',#{},#{})", formation, pdc));
  const int shape = add(fmt::format("PRODUCT_DEFINITION_SHAPE('','',#{})", definition));
  add(fmt::format("SHAPE_DEFINITION_REPRESENTATION(#{},#{})", shape, rep));
  return fmt::format(
      "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION(('virtual part'),'2;1');\nFILE_NAME('{}','2026-01-01T00:00:00',(''),(''),'asbuilt','asbuilt',"
      "'');\nFILE_SCHEMA(('AUTOMOTIVE_DESIGN {{ 1 0 10303 214 1 1 1 1 }}'));\nENDSEC;\nDATA;\n{}ENDSEC;\nEND-ISO-10303-21;\n",
      name, body_);
}

}  // namespace asbuilt::simulate_detail
