// SPDX-License-Identifier: GPL-3.0-or-later
// The nominal solid as STEP AP214: one MANIFOLD_SOLID_BREP, planes and cylinders, lines and circles, millimetres.
#include <fmt/format.h>

#include <map>

#include "planner/base/number.hpp"
#include "planner/base/result.hpp"
#include "planner/simulate/solid.hpp"

namespace asbuilt::simulate_detail {
namespace {

class Writer {
 public:
  int add(const std::string& text) {
    body_ += fmt::format("#{}={};\n", ++last_, text);
    return last_;
  }
  int point(const Vec3& p) { return add(fmt::format("CARTESIAN_POINT('',({}))", triple(p))); }
  int direction(const Vec3& d) { return add(fmt::format("DIRECTION('',({}))", triple(d))); }
  int placement(const Vec3& o, const Vec3& z, const Vec3& x) {
    const int a = point(o), b = direction(z), c = direction(x);
    return add(fmt::format("AXIS2_PLACEMENT_3D('',#{},#{},#{})", a, b, c));
  }
  int vertex(const Vec3& p) {
    const std::string key = triple(p);
    auto [it, fresh] = vertices_.try_emplace(key, 0);
    if (fresh) {
      const int c = point(p);
      it->second = add(fmt::format("VERTEX_POINT('',#{})", c));
    }
    return it->second;
  }
  int line_edge(const Vec3& a, const Vec3& b) {
    const int va = vertex(a), vb = vertex(b), o = point(a), d = direction((b - a).normalized());
    const int v = add(fmt::format("VECTOR('',#{},1.)", d));
    const int l = add(fmt::format("LINE('',#{},#{})", o, v));
    return add(fmt::format("EDGE_CURVE('',#{},#{},#{},.T.)", va, vb, l));
  }
  /// Counter-clockwise about `up` from a to b (a full circle when they are the same point).
  int circle_edge(const Vec3& center, const Vec3& up, double radius, const Vec3& a, const Vec3& b) {
    const int va = vertex(a), vb = vertex(b), p = placement(center, up, (a - center).normalized());
    const int c = add(fmt::format("CIRCLE('',#{},{})", p, real(radius)));
    return add(fmt::format("EDGE_CURVE('',#{},#{},#{},.T.)", va, vb, c));
  }
  int loop(const std::vector<std::pair<int, bool>>& edges) {
    std::string list;
    for (const auto& [e, forward] : edges) {
      const int o = add(fmt::format("ORIENTED_EDGE('',*,*,#{},.{}.)", e, forward ? 'T' : 'F'));
      list += fmt::format("{}#{}", list.empty() ? "" : ",", o);
    }
    return add(fmt::format("EDGE_LOOP('',({}))", list));
  }
  void face(int surface, bool same_sense, const std::vector<int>& loops) {
    std::string list;
    for (std::size_t i = 0; i < loops.size(); ++i) {
      const int b = add(fmt::format("{}('',#{},.T.)", i == 0 ? "FACE_OUTER_BOUND" : "FACE_BOUND", loops[i]));
      list += fmt::format("{}#{}", list.empty() ? "" : ",", b);
    }
    faces_.push_back(add(fmt::format("ADVANCED_FACE('',({}),#{},.{}.)", list, surface, same_sense ? 'T' : 'F')));
  }
  int surface(const Face& f, const Vec3& near) {
    if (f.is_cylinder) {
      const int p = placement(Vec3(f.cx_mm, f.cy_mm, 0), Vec3::UnitZ(), Vec3::UnitX());
      return add(fmt::format("CYLINDRICAL_SURFACE('',#{},{})", p, real(f.radius_mm)));
    }
    const int p = placement(near - f.n * f.signed_distance(near), f.n, std::abs(f.n.z()) > 0.9 ? Vec3::UnitX() : Vec3::UnitZ());
    return add(fmt::format("PLANE('',#{})", p));
  }
  std::string finish(const std::string& name) {
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

 private:
  int last_ = 0;
  std::string body_;
  std::vector<int> faces_;
  std::map<std::string, int> vertices_;

  static std::string real(double v) {
    std::string t = shortest_number(rounded(v, 9));
    const std::size_t e = t.find('e');
    if (t.find('.') == std::string::npos) t.insert(e == std::string::npos ? t.size() : e, ".");
    for (char& c : t)
      if (c == 'e') c = 'E';
    return t;
  }
  static std::string triple(const Vec3& p) { return real(p.x()) + "," + real(p.y()) + "," + real(p.z()); }
};

struct Rim {  // edges of one contour against one cap, each counter-clockwise about z
  std::vector<int> edges;
  std::vector<Vec3> starts;
};

Vec3 start_of(const Contour& c, std::size_t i, double z) {
  if (c.sides.size() == 1) return Vec3(c.sides[0].cx_mm + c.sides[0].radius_mm, c.sides[0].cy_mm, z);
  Vec3 p = c.corners[(i + c.sides.size() - 1) % c.sides.size()];
  p.z() = z;
  return p;
}

/// Edge i runs from start i to start i + 1, except a hollow arc, whose circle has to run the other way about its own axis.
Rim rim_of(Writer& w, const Contour& c, double z) {
  Rim r;
  for (std::size_t i = 0; i < c.sides.size(); ++i) {
    const Vec3 a = start_of(c, i, z), b = start_of(c, (i + 1) % c.sides.size(), z);
    const Face& f = c.sides[i];
    r.starts.push_back(a);
    if (!f.is_cylinder) {
      r.edges.push_back(w.line_edge(a, b));
    } else {
      const bool hollow = f.is_bore && c.sides.size() > 1;
      r.edges.push_back(w.circle_edge(Vec3(f.cx_mm, f.cy_mm, z), hollow ? Vec3(-Vec3::UnitZ()) : Vec3(Vec3::UnitZ()), f.radius_mm, a, b));
    }
  }
  return r;
}

std::vector<std::pair<int, bool>> around(const Rim& r, bool counter_clockwise) {
  std::vector<std::pair<int, bool>> out;
  for (int e : r.edges) out.emplace_back(e, counter_clockwise);
  if (!counter_clockwise) std::reverse(out.begin(), out.end());
  return out;
}

/// The side faces between two rims. `inside_out`: the contour bounds a bore.
void walls(Writer& w, const Contour& c, const Rim& low, const Rim& high, bool inside_out) {
  const std::size_t n = c.sides.size();
  std::vector<int> risers;
  for (std::size_t i = 0; i < n; ++i) risers.push_back(w.line_edge(low.starts[i], high.starts[i]));
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t j = (i + 1) % n;
    std::vector<std::pair<int, bool>> loop;
    if (!inside_out)
      loop = {{low.edges[i], true}, {risers[j], true}, {high.edges[i], false}, {risers[i], false}};
    else
      loop = {{risers[i], true}, {high.edges[i], true}, {risers[j], false}, {low.edges[i], false}};
    const int l = w.loop(loop), s = w.surface(c.sides[i], low.starts[i]);
    w.face(s, !c.sides[i].is_bore, {l});
  }
}

}  // namespace

std::string step_text(const Solid& s, const std::string& name) {
  Writer w;
  const double z0 = -s.bottom.d_mm, z1 = s.top.d_mm;
  const Rim outer_low = rim_of(w, s.outer, z0), outer_high = rim_of(w, s.outer, z1);
  std::vector<int> top_loops = {w.loop(around(outer_high, true))}, bottom_loops = {w.loop(around(outer_low, false))};
  walls(w, s.outer, outer_low, outer_high, false);
  for (const Contour& b : s.bores) {
    const Rim low = rim_of(w, b, z0), high = rim_of(w, b, z1);
    top_loops.push_back(w.loop(around(high, false)));
    bottom_loops.push_back(w.loop(around(low, true)));
    walls(w, b, low, high, true);
  }
  for (const Boss& b : s.bosses) {
    const Rim low = rim_of(w, b.contour, z1), high = rim_of(w, b.contour, b.top.d_mm);
    top_loops.push_back(w.loop(around(low, false)));
    walls(w, b.contour, low, high, false);
    const int l = w.loop(around(high, true)), t = w.surface(b.top, Vec3(0, 0, b.top.d_mm));
    w.face(t, true, {l});
  }
  const int t = w.surface(s.top, Vec3(0, 0, z1)), b = w.surface(s.bottom, Vec3(0, 0, z0));
  w.face(t, true, top_loops);
  w.face(b, true, bottom_loops);
  return w.finish(name);
}

}  // namespace asbuilt::simulate_detail
