// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/simulate/solid.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/result.hpp"

namespace asbuilt::simulate_detail {

double Face::signed_distance(const Vec3& p) const {
  if (!is_cylinder) return n.dot(p) - d_mm;
  const double r = std::hypot(p.x() - cx_mm, p.y() - cy_mm) - radius_mm;
  return is_bore ? -r : r;
}

Vec3 Face::outward(const Vec3& p) const {
  if (!is_cylinder) return n;
  const Vec3 e = Vec3(p.x() - cx_mm, p.y() - cy_mm, 0).normalized();
  return is_bore ? Vec3(-e) : e;
}

namespace {

/// Newton on three faces; every start is within a fraction of a millimetre.
Vec3 corner_of(const Face& a, const Face& b, const Face& c, Vec3 p) {
  for (int i = 0; i < 30; ++i) {
    Mat3 m;
    m.row(0) = a.outward(p);
    m.row(1) = b.outward(p);
    m.row(2) = c.outward(p);
    const Vec3 f(a.signed_distance(p), b.signed_distance(p), c.signed_distance(p));
    p -= m.partialPivLu().solve(f);
    if (f.norm() < 1e-12) break;
  }
  return p;
}

/// The point where a vertical line's neighbourhood of p meets side and cap: two faces, moved in the plane of their normals.
Vec3 onto_both(const Face& side, const Face& cap, Vec3 p) {
  for (int i = 0; i < 30; ++i) {
    const Vec3 n1 = side.outward(p), n2 = cap.outward(p);
    Mat3 m;
    m.row(0) = n1;
    m.row(1) = n2;
    m.row(2) = n1.cross(n2);
    const Vec3 f(side.signed_distance(p), cap.signed_distance(p), 0);
    p -= m.partialPivLu().solve(f);
    if (f.norm() < 1e-13) break;
  }
  return p;
}

/// Side i of a contour against a cap, counter-clockwise from its first corner to its second.
std::vector<Vec3> run_of(const Contour& c, std::size_t i, const Face& cap, double step_mm) {
  std::vector<Vec3> out;
  const Face& side = c.sides[i];
  if (c.sides.size() == 1) {  // a full circle
    const int n = std::max(24, static_cast<int>(std::ceil(2 * kPi * side.radius_mm / step_mm)));
    for (int k = 0; k <= n; ++k) {
      const double a = 2 * kPi * (k % n) / n;
      out.push_back(onto_both(side, cap, Vec3(side.cx_mm + side.radius_mm * std::cos(a), side.cy_mm + side.radius_mm * std::sin(a),
                                              cap.d_mm / std::max(0.5, std::abs(cap.n.z())) * (cap.n.z() < 0 ? -1 : 1))));
    }
    return out;
  }
  const std::size_t m = c.sides.size();
  const Vec3 from = corner_of(c.sides[(i + m - 1) % m], side, cap, c.corners[(i + m - 1) % m]);
  const Vec3 to = corner_of(side, c.sides[(i + 1) % m], cap, c.corners[i]);
  if (!side.is_cylinder) {
    const int n = std::max(1, static_cast<int>(std::ceil((to - from).norm() / step_mm)));
    for (int k = 0; k <= n; ++k) out.push_back(from + (to - from) * (static_cast<double>(k) / n));
    return out;
  }
  const double a0 = std::atan2(from.y() - side.cy_mm, from.x() - side.cx_mm);
  double a1 = std::atan2(to.y() - side.cy_mm, to.x() - side.cx_mm);
  // counter-clockwise around the contour: along the outside of a boss the angle grows, along its inner arc it falls
  while (a1 - a0 > kPi) a1 -= 2 * kPi;
  while (a1 - a0 < -kPi) a1 += 2 * kPi;
  const int n = std::max(2, static_cast<int>(std::ceil(std::abs(a1 - a0) * side.radius_mm / step_mm)));
  for (int k = 0; k <= n; ++k) {
    const double a = a0 + (a1 - a0) * k / n;
    Vec3 p(side.cx_mm + side.radius_mm * std::cos(a), side.cy_mm + side.radius_mm * std::sin(a), from.z());
    out.push_back(k == 0 ? from : k == n ? to : onto_both(side, cap, p));
  }
  return out;
}

Face plane(const Vec3& n, const Vec3& through) {
  Face f;
  f.n = n.normalized();
  f.d_mm = f.n.dot(through);
  return f;
}
Face cylinder(double radius, bool bore) {
  Face f;
  f.is_cylinder = true;
  f.radius_mm = radius;
  f.is_bore = bore;
  return f;
}

Contour rectangle(double x0, double y0, double x1, double y1, double z) {
  Contour c;
  c.sides = {plane(-Vec3::UnitY(), Vec3(x0, y0, z)), plane(Vec3::UnitX(), Vec3(x1, y0, z)), plane(Vec3::UnitY(), Vec3(x1, y1, z)),
             plane(-Vec3::UnitX(), Vec3(x0, y1, z))};
  c.corners = {Vec3(x1, y0, z), Vec3(x1, y1, z), Vec3(x0, y1, z), Vec3(x0, y0, z)};
  return c;
}

/// A lug between two radii around the part's z axis, its flanks parallel to the radial plane through its middle.
Contour lug(double r0, double r1, double middle_rad, double half_width_mm, double z) {
  const Vec3 er(std::cos(middle_rad), std::sin(middle_rad), 0), et(-er.y(), er.x(), 0);
  const auto at = [&](double r, double w) { return Vec3(er * std::sqrt(r * r - w * w) + et * w + Vec3(0, 0, z)); };
  Contour c;
  c.sides = {cylinder(r1, false), plane(et, at(r1, half_width_mm)), cylinder(r0, true), plane(-et, at(r1, -half_width_mm))};
  c.corners = {at(r1, half_width_mm), at(r0, half_width_mm), at(r0, -half_width_mm), at(r1, -half_width_mm)};
  return c;
}

}  // namespace

Solid make_ring(bool with_lugs) {
  Solid s;
  s.bottom = plane(-Vec3::UnitZ(), Vec3(0, 0, 0));
  s.top = plane(Vec3::UnitZ(), Vec3(0, 0, 28));
  s.outer.sides = {cylinder(145, false)};
  Contour bore;
  bore.sides = {cylinder(112, true)};
  s.bores = {bore};
  if (with_lugs) {
    const int count = 6;
    for (int k = 0; k < count; ++k) {
      Boss b;
      b.id = "lug" + std::to_string(k);
      // one lug is wider: the only thing that tells the six turns apart
      b.contour = lug(120, 139, 2 * kPi * k / count, k == 1 ? 23 : 16, 38);
      b.top = plane(Vec3::UnitZ(), Vec3(0, 0, 38));
      s.bosses.push_back(b);
    }
    s.features = {"lug1", "lug4"};
  }
  return s;
}

Solid make_bracket() {
  Solid s;
  s.bottom = plane(-Vec3::UnitZ(), Vec3(0, 0, 0));
  s.top = plane(Vec3::UnitZ(), Vec3(0, 0, 18));
  s.outer = rectangle(0, 0, 150, 90, 18);
  Boss wall;
  wall.id = "wall";
  wall.contour = rectangle(98, 16, 114, 76, 58);
  wall.top = plane(Vec3::UnitZ(), Vec3(0, 0, 58));
  Boss pad;
  pad.id = "pad";
  pad.contour = rectangle(20, 24, 62, 60, 30);
  pad.top = plane(Vec3::UnitZ(), Vec3(0, 0, 30));
  s.bosses = {wall, pad};
  s.features = {"wall", "pad"};
  return s;
}

Solid as_made(const Solid& nominal, Random& random, double scale) {
  Solid s = nominal;
  const auto disturb = [&](Face& f, double pivot_z) {
    if (f.is_cylinder) {
      f.radius_mm += random.normal(0, 0.08 * scale);
      f.cx_mm += random.normal(0, 0.06 * scale);
      f.cy_mm += random.normal(0, 0.06 * scale);
      return;
    }
    const Vec3 through = f.n * f.d_mm + (Vec3(0, 0, pivot_z) - f.n * f.n.z() * pivot_z);
    f.n = (quat_exp(Vec3(random.normal(), random.normal(), random.normal()) * (0.0008 * scale)) * f.n).normalized();
    f.d_mm = f.n.dot(through) + random.normal(0, 0.10 * scale);
  };
  const auto disturb_contour = [&](Contour& c, double z) {
    for (std::size_t i = 0; i < c.sides.size(); ++i) {
      Face& f = c.sides[i];
      if (!f.is_cylinder) {
        // tilt about a point of the face itself, so that a far face is not moved by its tilt
        const Vec3 middle = 0.5 * (c.corners[i] + c.corners[(i + c.sides.size() - 1) % c.sides.size()]);
        f.n = (quat_exp(Vec3(random.normal(), random.normal(), random.normal()) * (0.0010 * scale)) * f.n).normalized();
        f.d_mm = f.n.dot(middle) + random.normal(0, 0.10 * scale);
      } else {
        disturb(f, z);
      }
    }
  };
  disturb(s.bottom, 0);
  disturb(s.top, nominal.top.d_mm);
  disturb_contour(s.outer, nominal.top.d_mm);
  for (Contour& b : s.bores) disturb_contour(b, nominal.top.d_mm);
  for (Boss& b : s.bosses) {
    Vec3 middle = Vec3::Zero();
    for (const Vec3& c : b.contour.corners) middle += c / static_cast<double>(b.contour.corners.size());
    b.top.n = (quat_exp(Vec3(random.normal(), random.normal(), 0) * (0.0012 * scale)) * b.top.n).normalized();
    b.top.d_mm = b.top.n.dot(middle) + random.normal(0, 0.10 * scale);
    disturb_contour(b.contour, b.top.d_mm);
  }
  return s;
}

namespace {

void add_strip(Mesh& m, const std::vector<Vec3>& low, const std::vector<Vec3>& high, bool outward) {
  const int base = static_cast<int>(m.vertices.size()), n = static_cast<int>(std::min(low.size(), high.size()));
  for (int i = 0; i < n; ++i) m.vertices.push_back(low[i]), m.vertices.push_back(high[i]);
  for (int i = 0; i + 1 < n; ++i) {
    const int a = base + 2 * i, b = a + 1, c = a + 2, d = a + 3;
    if (outward) {
      m.triangles.push_back({a, c, d}), m.triangles.push_back({a, d, b});
    } else {
      m.triangles.push_back({a, d, c}), m.triangles.push_back({a, b, d});
    }
  }
}

std::vector<Vec3> resampled(const std::vector<Vec3>& run, std::size_t n) {
  std::vector<Vec3> out;
  for (std::size_t k = 0; k < n; ++k) {
    const double t = static_cast<double>(k) * static_cast<double>(run.size() - 1) / static_cast<double>(n - 1);
    const std::size_t i = std::min(static_cast<std::size_t>(t), run.size() - 2);
    out.push_back(run[i] + (run[i + 1] - run[i]) * (t - static_cast<double>(i)));
  }
  return out;
}

std::vector<Vec3> ring_of(const Contour& c, const Face& cap, double step) {
  std::vector<Vec3> out;
  for (std::size_t i = 0; i < c.sides.size(); ++i) {
    std::vector<Vec3> r = run_of(c, i, cap, step);
    r.pop_back();
    out.insert(out.end(), r.begin(), r.end());
  }
  return out;
}

void add_fan(Mesh& m, const std::vector<Vec3>& ring, bool up) {
  Vec3 c = Vec3::Zero();
  for (const Vec3& p : ring) c += p / static_cast<double>(ring.size());
  const int base = static_cast<int>(m.vertices.size()), n = static_cast<int>(ring.size());
  m.vertices.push_back(c);
  m.vertices.insert(m.vertices.end(), ring.begin(), ring.end());
  for (int i = 0; i < n; ++i) {
    const int a = base + 1 + i, b = base + 1 + (i + 1) % n;
    m.triangles.push_back(up ? std::array<int, 3>{base, a, b} : std::array<int, 3>{base, b, a});
  }
}

}  // namespace

Mesh mesh_of(const Solid& s, double step_mm) {
  Mesh m;
  const auto walls = [&](const Contour& c, const Face& low, const Face& high, bool bore) {
    for (std::size_t i = 0; i < c.sides.size(); ++i) {
      std::vector<Vec3> a = run_of(c, i, low, step_mm), b = run_of(c, i, high, step_mm);
      const std::size_t n = std::max(a.size(), b.size());
      add_strip(m, resampled(a, n), resampled(b, n), !bore);
    }
  };
  walls(s.outer, s.bottom, s.top, false);
  for (const Contour& b : s.bores) walls(b, s.bottom, s.top, true);
  if (s.bores.empty()) {
    add_fan(m, ring_of(s.outer, s.top, step_mm), true);
    add_fan(m, ring_of(s.outer, s.bottom, step_mm), false);
  } else {
    must(s.bores.size() == 1, "a virtual body has at most one bore");
    for (const Face* cap : {&s.top, &s.bottom}) {
      std::vector<Vec3> o = ring_of(s.outer, *cap, step_mm), i = ring_of(s.bores[0], *cap, step_mm);
      o.push_back(o.front()), i.push_back(i.front());
      const std::size_t n = std::max(o.size(), i.size());
      add_strip(m, resampled(o, n), resampled(i, n), cap == &s.top);
    }
  }
  for (const Boss& b : s.bosses) {
    walls(b.contour, s.top, b.top, false);
    add_fan(m, ring_of(b.contour, b.top, step_mm), true);
  }
  return m;
}

std::vector<TrueEdge> worked_edges(const Solid& s, double step_mm) {
  std::vector<TrueEdge> out;
  const auto add = [&](const std::string& feature, const Contour& c, const Face& cap) {
    for (std::size_t i = 0; i < c.sides.size(); ++i) {
      TrueEdge e;
      e.feature = feature;
      e.id = feature + "-" + std::to_string(i);
      e.is_closed = c.sides.size() == 1;
      e.p = run_of(c, i, cap, step_mm);
      for (std::size_t k = 0; k < e.p.size(); ++k) {
        const Vec3 n1 = cap.outward(e.p[k]), n2 = c.sides[i].outward(e.p[k]);
        Vec3 t = n1.cross(n2).normalized();
        const Vec3 along = e.p[std::min(k + 1, e.p.size() - 1)] - e.p[k == 0 ? 0 : k - 1];
        if (t.dot(along) < 0) t = -t;
        e.tangent.push_back(t), e.n_1.push_back(n1), e.n_2.push_back(n2);
        e.s_mm.push_back(k == 0 ? 0.0 : e.s_mm.back() + (e.p[k] - e.p[k - 1]).norm());
      }
      out.push_back(std::move(e));
    }
  };
  for (const std::string& f : s.features) {
    if (f == "body") {
      add(f, s.outer, s.top);
      continue;
    }
    for (const Boss& b : s.bosses)
      if (b.id == f) add(f, b.contour, b.top);
  }
  return out;
}

}  // namespace asbuilt::simulate_detail
