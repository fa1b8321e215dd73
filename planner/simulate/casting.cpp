// SPDX-License-Identifier: GPL-3.0-or-later
// A casting: a flange whose upper rim is the parting line, with drafted sides and rounded corners, and on it a block and a boss
// with draft, foot fillets and rounded tops. It comes out of the mould shrunk and bent, its cores shifted, flash along the
// parting line, the stubs of riser and feeder left standing. Every face is a plane, cone, cylinder or torus.
#include <algorithm>
#include <cmath>

#include "planner/simulate/deformation.hpp"
#include "planner/simulate/files.hpp"
#include "planner/simulate/part_model.hpp"
#include "planner/simulate/step_writer.hpp"

namespace asbuilt::simulate_detail {
namespace {

struct Profile {  // one step of the outline of a stack: offset outward from the path, height
  double o, z;
  bool is_arc = false;  // the way to the next point is an arc about (oc, zc)
  double oc = 0, zc = 0;
  bool is_hollow = false;  // the arc's material is outside (a fillet)
};

/// A profile led around a rectangle with rounded corners (a circle where the half sizes equal the radius).
struct Stack {
  Vec3 center = Vec3::Zero();
  double half_x = 0, half_y = 0, radius = 0;
  std::vector<Profile> profile;  // from below

  bool is_circle() const { return half_x <= radius && half_y <= radius; }
  struct Element {
    bool is_arc;
    Vec3 from, to, axis;  // at offset 0 and height 0; axis: the arc's centre
    Vec3 out_from, out_to;
  };
  std::vector<Element> elements() const {
    std::vector<Element> all;
    const double x = half_x - radius, y = half_y - radius;
    const Vec3 corner[4] = {Vec3(x, -y, 0), Vec3(x, y, 0), Vec3(-x, y, 0), Vec3(-x, -y, 0)};
    const Vec3 out[4] = {-Vec3::UnitY(), Vec3::UnitX(), Vec3::UnitY(), -Vec3::UnitX()};
    for (int k = 0; k < 4; ++k) {
      if (!is_circle()) {
        const Vec3 a = center + corner[(k + 3) % 4] + radius * out[k], b = center + corner[k] + radius * out[k];
        all.push_back({false, a, b, Vec3::Zero(), out[k], out[k]});
      }
      const Vec3 c = center + corner[k];
      all.push_back({true, c + radius * out[k], c + radius * out[(k + 1) % 4], c, out[k], out[(k + 1) % 4]});
    }
    return all;
  }
};

Vec3 at(const Vec3& p, const Vec3& out, double o, double z) { return p + o * out + z * Vec3::UnitZ(); }

/// Draft in rad; foot: radius of the fillet at the foot (0: none), top: of the rounding at the top (0: none).
std::vector<Profile> drafted(double height, double draft, double foot, double top) {
  // offset 0 is the wall, extended down to z = 0
  const double t = std::tan(draft), c = std::cos(draft), s = std::sin(draft);
  std::vector<Profile> p;
  if (foot > 0) {
    // the fillet's centre is `foot` above the plane and `foot` out from the wall
    const double zc = foot, oc = -zc * t + foot / c;
    p.push_back({oc, 0, true, oc, zc, true});
    p.push_back({oc - foot * c, zc - foot * s});
  } else {
    p.push_back({0, 0});
  }
  if (top > 0) {
    const double zc = height - top, oc = -zc * t - top / c;
    p.push_back({oc + top * c, zc + top * s, true, oc, zc, false});
    p.push_back({oc, height});
  } else {
    p.push_back({-height * t, height});
  }
  return p;
}

std::vector<Profile> sampled(const std::vector<Profile>& profile, double step) {
  std::vector<Profile> out;
  for (std::size_t k = 0; k + 1 < profile.size(); ++k) {
    const Profile &a = profile[k], &b = profile[k + 1];
    if (!a.is_arc) {
      const int n = std::max(1, static_cast<int>(std::ceil(std::hypot(b.o - a.o, b.z - a.z) / step)));
      for (int i = 0; i < n; ++i) out.push_back({a.o + (b.o - a.o) * i / n, a.z + (b.z - a.z) * i / n});
      continue;
    }
    const double r = std::hypot(a.o - a.oc, a.z - a.zc), f = std::atan2(a.z - a.zc, a.o - a.oc);
    double g = std::atan2(b.z - a.zc, b.o - a.oc);
    while (g - f > kPi) g -= 2 * kPi;
    while (g - f < -kPi) g += 2 * kPi;
    const int n = std::max(4, static_cast<int>(std::ceil(std::abs(g - f) * r / std::min(step, 0.5))));
    for (int i = 0; i < n; ++i) out.push_back({a.oc + r * std::cos(f + (g - f) * i / n), a.zc + r * std::sin(f + (g - f) * i / n)});
  }
  out.push_back(profile.back());
  return out;
}

struct ContourPoint {
  Vec3 p, out;
};
std::vector<ContourPoint> contour_of(const Stack& s, double step) {
  std::vector<ContourPoint> c;
  for (const Stack::Element& e : s.elements()) {
    const double length = e.is_arc ? s.radius * kPi / 2 : (e.to - e.from).norm();
    const double chord = e.is_arc ? std::min(step, std::sqrt(8 * 0.002 * s.radius)) : step;  // no more than 2 micrometres off the arc
    const int n = std::max(e.is_arc ? 8 : 1, static_cast<int>(std::ceil(length / chord)));
    for (int i = 0; i < n; ++i) {
      const double t = static_cast<double>(i) / n;
      if (!e.is_arc) {
        c.push_back({e.from + t * (e.to - e.from), e.out_from});
      } else {
        const Vec3 out = std::cos(t * kPi / 2) * e.out_from + std::sin(t * kPi / 2) * e.out_to;
        c.push_back({e.axis + s.radius * out, out});
      }
    }
  }
  return c;
}

void add_cap(Mesh& m, const std::vector<Vec3>& rim, bool up, double step) {
  Vec3 c = Vec3::Zero();
  double reach = 0;
  for (const Vec3& p : rim) c += p / static_cast<double>(rim.size());
  for (const Vec3& p : rim) reach = std::max(reach, (p - c).norm());
  const int rings = std::max(1, static_cast<int>(std::ceil(reach / step))), n = static_cast<int>(rim.size()), base = static_cast<int>(m.vertices.size());
  for (int j = 1; j <= rings; ++j)
    for (const Vec3& p : rim) m.vertices.push_back(c + (p - c) * (static_cast<double>(j) / rings));
  m.vertices.push_back(c);
  const int middle = static_cast<int>(m.vertices.size()) - 1;
  const auto add = [&](int a, int b, int d) { m.triangles.push_back(up ? std::array<int, 3>{a, b, d} : std::array<int, 3>{a, d, b}); };
  for (int i = 0; i < n; ++i) {
    const int k = (i + 1) % n;
    add(middle, base + i, base + k);
    for (int j = 0; j + 1 < rings; ++j) {
      const int a = base + j * n;
      add(a + i, a + n + i, a + n + k), add(a + i, a + n + k, a + k);
    }
  }
}

/// Closed by itself; stacks standing on one another overlap inside, where no ray gets.
Mesh mesh_of(const Stack& s, double step) {
  Mesh m;
  const std::vector<Profile> profile = sampled(s.profile, step);
  const std::vector<ContourPoint> contour = contour_of(s, step);
  const int n = static_cast<int>(contour.size());
  for (const Profile& q : profile)
    for (const ContourPoint& c : contour) m.vertices.push_back(at(c.p, c.out, q.o, q.z));
  for (std::size_t j = 0; j + 1 < profile.size(); ++j)
    for (int i = 0; i < n; ++i) {
      const int a = static_cast<int>(j) * n + i, b = static_cast<int>(j) * n + (i + 1) % n;
      m.triangles.push_back({a, b, b + n}), m.triangles.push_back({a, b + n, a + n});
    }
  std::vector<Vec3> low(m.vertices.begin(), m.vertices.begin() + n), high(m.vertices.end() - n, m.vertices.end());
  add_cap(m, low, false, step), add_cap(m, high, true, step);
  return m;
}

// ---- STEP

struct StackRims {
  std::vector<std::vector<int>> edges;  // by profile point, by element
};

StackRims write_stack(StepWriter& w, const Stack& s) {
  StackRims rims;
  const auto elements = s.elements();
  const std::size_t n = elements.size();
  for (const Profile& q : s.profile) {
    rims.edges.emplace_back();
    for (const Stack::Element& e : elements) {
      const Vec3 a = at(e.from, e.out_from, q.o, q.z), b = at(e.to, e.out_to, q.o, q.z);
      rims.edges.back().push_back(e.is_arc ? w.circle_edge(e.axis + q.z * Vec3::UnitZ(), Vec3::UnitZ(), s.radius + q.o, a, b) : w.line_edge(a, b));
    }
  }
  for (std::size_t k = 0; k + 1 < s.profile.size(); ++k) {
    const Profile &a = s.profile[k], &b = s.profile[k + 1];
    std::vector<int> risers;
    for (const Stack::Element& e : elements) {
      const Vec3 pa = at(e.from, e.out_from, a.o, a.z), pb = at(e.from, e.out_from, b.o, b.z);
      if (!a.is_arc) {
        risers.push_back(w.line_edge(pa, pb));
      } else {
        // the circle turns from a to b by less than a half turn
        const Vec3 c = at(e.from, e.out_from, a.oc, a.zc);
        risers.push_back(w.circle_edge(c, (pa - c).cross(pb - c).normalized(), (pa - c).norm(), pa, pb));
      }
    }
    for (std::size_t i = 0; i < n; ++i) {
      const Stack::Element& e = elements[i];
      const int loop = w.loop({{rims.edges[k][i], true}, {risers[(i + 1) % n], true}, {rims.edges[k + 1][i], false}, {risers[i], false}});
      const Vec3 low = at(e.from, e.out_from, a.o, a.z);
      const double lean = std::atan2(b.o - a.o, b.z - a.z);
      if (!a.is_arc && !e.is_arc) {
        w.face(w.plane(low, (e.out_from * (b.z - a.z) - Vec3::UnitZ() * (b.o - a.o)).normalized()), true, {loop});
      } else if (!a.is_arc) {
        const Vec3 axis = lean < 0 ? Vec3(-Vec3::UnitZ()) : Vec3(Vec3::UnitZ());
        w.face(w.cone(e.axis + a.z * Vec3::UnitZ(), axis, s.radius + a.o, std::abs(lean)), true, {loop});
      } else if (!e.is_arc) {
        w.face(w.cylinder(at(e.from, e.out_from, a.oc, a.zc), (e.to - e.from).normalized(), std::hypot(a.o - a.oc, a.z - a.zc)), !a.is_hollow, {loop});
      } else {
        w.face(w.torus(e.axis + a.zc * Vec3::UnitZ(), Vec3::UnitZ(), s.radius + a.oc, std::hypot(a.o - a.oc, a.z - a.zc)), !a.is_hollow, {loop});
      }
    }
  }
  return rims;
}

std::vector<std::pair<int, bool>> around(const std::vector<int>& edges, bool counter_clockwise) {
  std::vector<std::pair<int, bool>> out;
  for (int e : edges) out.emplace_back(e, counter_clockwise);
  if (!counter_clockwise) std::reverse(out.begin(), out.end());
  return out;
}

std::string step_of(const Stack& flange, const std::vector<Stack>& standing) {
  StepWriter w;
  const StackRims base = write_stack(w, flange);
  std::vector<int> top = {w.loop(around(base.edges.back(), true))};
  w.face(w.plane(Vec3(0, 0, flange.profile.front().z), -Vec3::UnitZ()), true, {w.loop(around(base.edges.front(), false))});
  for (const Stack& s : standing) {
    const StackRims rims = write_stack(w, s);
    top.push_back(w.loop(around(rims.edges.front(), false)));
    w.face(w.plane(s.center + Vec3(0, 0, s.profile.back().z), Vec3::UnitZ()), true, {w.loop(around(rims.edges.back(), true))});
  }
  w.face(w.plane(Vec3(0, 0, flange.profile.back().z), Vec3::UnitZ()), true, top);
  return w.finish("casting");
}

/// The parting line: the flange's upper rim, one edge an element.
std::vector<TrueEdge> parting_line(const Stack& flange, const Deformation& d, double step) {
  std::vector<TrueEdge> out;
  const Profile &low = flange.profile.front(), &rim = flange.profile.back();
  int count = 0;
  for (const Stack::Element& e : flange.elements()) {
    TrueEdge edge;
    edge.feature = "flash";
    edge.id = "flash-" + std::to_string(count++);
    const double length = e.is_arc ? flange.radius * kPi / 2 : (e.to - e.from).norm();
    const int n = std::max(8, static_cast<int>(std::ceil(length / step)));
    for (int i = 0; i <= n; ++i) {
      const double t = static_cast<double>(i) / n;
      const Vec3 o = e.is_arc ? Vec3(std::cos(t * kPi / 2) * e.out_from + std::sin(t * kPi / 2) * e.out_to) : e.out_from;
      const Vec3 p = at(e.is_arc ? Vec3(e.axis + flange.radius * o) : Vec3(e.from + t * (e.to - e.from)), o, rim.o, rim.z);
      const Vec3 side = (o * (rim.z - low.z) - Vec3::UnitZ() * (rim.o - low.o)).normalized();
      edge.p.push_back(d.point(p));
      edge.n_1.push_back(d.normal(p, Vec3::UnitZ())), edge.n_2.push_back(d.normal(p, side));
      edge.tangent.push_back((d.gradient(p) * Vec3(-o.y(), o.x(), 0)).normalized());
      edge.s_mm.push_back(i == 0 ? 0.0 : edge.s_mm.back() + (edge.p[i] - edge.p[i - 1]).norm());
    }
    out.push_back(std::move(edge));
  }
  return out;
}

}  // namespace

PartModel make_casting(Random& random) {
  const double draft = rad_from_deg(2), thick = 14;
  Stack flange;
  flange.half_x = 74, flange.half_y = 52, flange.radius = 18;
  flange.profile = {{-thick * std::tan(draft), -thick}, {0, 0}};
  Stack block;
  block.center = Vec3(-9, 4, 0);
  block.half_x = 32, block.half_y = 21, block.radius = 10;
  block.profile = drafted(30, draft, 4, 3);
  Stack boss;
  boss.center = Vec3(44, -18, 0);
  boss.half_x = boss.half_y = boss.radius = 9;
  boss.profile = drafted(12, draft, 2, 0);

  PartModel part;
  part.step = step_of(flange, {block, boss});
  const double mesh_step = 2.0;
  part.drawn = mesh_of(flange, mesh_step);
  append(part.drawn, mesh_of(block, mesh_step)), append(part.drawn, mesh_of(boss, mesh_step));
  part.drawn_edges = parting_line(flange, {}, 0.25);

  // as made: what the mould shrank, bent and roughened; cores a little beside their place; riser and feeder cut off roughly
  Deformation d;
  d.scale = random.normal(0, 0.0012);
  add_waves(d, 12, random.uniform(0.12, 0.40), 90, 320, random);
  add_waves(d, 24, random.uniform(0.003, 0.012), 12, 40, random);
  part.made = mesh_of(flange, mesh_step);
  for (Stack s : {block, boss}) {
    s.center += Vec3(random.normal(0, 0.12), random.normal(0, 0.12), 0);
    append(part.made, mesh_of(s, mesh_step));
  }
  const double riser = random.uniform(7, 11), riser_height = random.uniform(6, 14);
  const Vec3 riser_at = block.center + Vec3(random.uniform(-12, 12), random.uniform(-4, 4), 28);
  Mesh stub = cylinder_mesh(riser, 0, 2 + riser_height, 36);
  for (Vec3& v : stub.vertices) v += riser_at + Vec3(0, 0, v.z() > 1 ? 0.15 * (v.x() + v.y()) : 0);  // broken off slantwise
  append(part.made, stub);
  const double feeder = random.uniform(3, 5);
  Mesh gate = box_mesh(Vec3(-feeder, -feeder, 0), Vec3(feeder, feeder, random.uniform(2, 6)));
  for (Vec3& v : gate.vertices) v += Vec3(-50, -26, -1);
  append(part.made, gate);
  for (Vec3& v : part.made.vertices) v = d.point(v);
  part.made_edges = parting_line(flange, d, 0.25);

  part.features = {"flash"};
  part.pivot = Vec3(0, 0, -thick), part.look_at = Vec3(0, 0, 8), part.support_mm = Vec3(58, 38, 0);
  part.burr = {true, 0.5, 1.3, 2.8, 0.18, 0.12};
  part.recipe_id = "deflash-0.5";
  part.width_mm = 0.5, part.tolerance_mm = 0.15, part.burr_max_mm = 3.5, part.removal_max_mm3_s = 6;
  part.burr_zone = "burr_zone:\n  parting_plane: {point: [0, 0, 0], normal: [0, 0, 1]}\n  width: 4\n";
  part.material = "EN-GJL-250";
  return part;
}

}  // namespace asbuilt::simulate_detail
