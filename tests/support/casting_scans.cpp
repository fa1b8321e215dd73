// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/support/casting_scans.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "planner/base/random.hpp"

namespace asbuilt::casting_scans {
namespace {

using Outline = std::vector<Vec2>;

/// Walls and, where asked for, bottom and lid (ear clipping) of an extruded outline, counter-clockwise.
void extrude(const Outline& o, double z0, double z1, bool has_bottom, Mesh& m) {
  const int first = static_cast<int>(m.vertices.size()), n = static_cast<int>(o.size());
  for (const double z : {z0, z1})
    for (const Vec2& p : o) m.vertices.push_back({p.x(), p.y(), z});
  for (int i = 0; i < n; ++i) {
    const int j = (i + 1) % n;
    m.triangles.push_back({first + i, first + j, first + n + j}), m.triangles.push_back({first + i, first + n + j, first + n + i});
  }
  std::vector<int> left;
  for (int i = 0; i < n; ++i) left.push_back(i);
  const auto area = [&](int a, int b, int c) {
    const Vec2 u = o[static_cast<std::size_t>(b)] - o[static_cast<std::size_t>(a)], v = o[static_cast<std::size_t>(c)] - o[static_cast<std::size_t>(a)];
    return u.x() * v.y() - u.y() * v.x();
  };
  while (left.size() > 2) {
    bool is_cut = false;
    for (std::size_t k = 0; k < left.size() && !is_cut; ++k) {
      const int a = left[(k + left.size() - 1) % left.size()], b = left[k], c = left[(k + 1) % left.size()];
      if (area(a, b, c) <= 1e-9) continue;
      const bool is_empty = std::none_of(left.begin(), left.end(), [&](int q) {
        return q != a && q != b && q != c && area(a, b, q) >= 0 && area(b, c, q) >= 0 && area(c, a, q) >= 0;
      });
      if (!is_empty) continue;
      m.triangles.push_back({first + n + a, first + n + b, first + n + c});
      if (has_bottom) m.triangles.push_back({first + c, first + b, first + a});
      left.erase(left.begin() + static_cast<std::ptrdiff_t>(k)), is_cut = true;
    }
    if (!is_cut) break;
  }
}

Outline circle(double x, double y, double r, int sides = 48) {
  Outline o;
  for (int i = 0; i < sides; ++i) o.push_back({x + r * std::cos(2 * kPi * i / sides), y + r * std::sin(2 * kPi * i / sides)});
  return o;
}
Outline box(double x0, double y0, double x1, double y1) { return {{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}}; }

/// Triangles in cells of a grid; a ray walks through them.
class Rays {
 public:
  explicit Rays(const Mesh& mesh) : mesh_(mesh) {
    const Box3 b = mesh.box();
    cell_ = std::max(1.0, b.diagonal_mm() / 60), low_ = b.min_mm - Vec3::Constant(0.01 + cell_);
    for (int a = 0; a < 3; ++a) count_[a] = static_cast<int>((b.max_mm[a] - low_[a]) / cell_) + 2;
    cells_.resize(static_cast<std::size_t>(count_[0]) * static_cast<std::size_t>(count_[1]) * static_cast<std::size_t>(count_[2]));
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      Box3 box;
      for (const int v : mesh.triangles[t]) box.extend(mesh.vertices[static_cast<std::size_t>(v)]);
      int lo[3], hi[3];
      for (int a = 0; a < 3; ++a) lo[a] = at(box.min_mm[a], a), hi[a] = at(box.max_mm[a], a);
      for (int k = lo[2]; k <= hi[2]; ++k)
        for (int j = lo[1]; j <= hi[1]; ++j)
          for (int i = lo[0]; i <= hi[0]; ++i) cells_[index(i, j, k)].push_back(static_cast<int>(t));
    }
  }

  /// Distance along the unit direction and the triangle; infinite where nothing is hit.
  std::pair<double, int> first(const Vec3& o, const Vec3& d) const {
    double enter = 0, leave = 1e9;
    for (int a = 0; a < 3; ++a) {
      const double inverse = 1 / (std::abs(d[a]) < 1e-12 ? 1e-12 : d[a]), high = low_[a] + count_[a] * cell_;
      const double t0 = (low_[a] - o[a]) * inverse, t1 = (high - o[a]) * inverse;
      enter = std::max(enter, std::min(t0, t1)), leave = std::min(leave, std::max(t0, t1));
    }
    std::pair<double, int> best{std::numeric_limits<double>::infinity(), -1};
    if (enter > leave) return best;
    const Vec3 p = o + (enter + 1e-9) * d;
    int c[3], step[3];
    double next[3], width[3];
    for (int a = 0; a < 3; ++a) {
      c[a] = at(p[a], a), step[a] = d[a] > 0 ? 1 : -1;
      const double along = std::abs(d[a]) < 1e-12 ? 1e-12 : d[a];
      next[a] = (low_[a] + (c[a] + (step[a] > 0)) * cell_ - o[a]) / along, width[a] = cell_ / std::abs(along);
    }
    for (;;) {
      for (const int t : cells_[index(c[0], c[1], c[2])]) {
        const auto& f = mesh_.triangles[static_cast<std::size_t>(t)];
        const Vec3 &v0 = mesh_.vertices[static_cast<std::size_t>(f[0])], e1 = mesh_.vertices[static_cast<std::size_t>(f[1])] - v0,
                   e2 = mesh_.vertices[static_cast<std::size_t>(f[2])] - v0;
        const Vec3 h = d.cross(e2);
        const double det = e1.dot(h);
        if (std::abs(det) < 1e-14) continue;
        const Vec3 s = o - v0, q = s.cross(e1);
        const double u = s.dot(h) / det, v = d.dot(q) / det, r = e2.dot(q) / det;
        if (u >= 0 && v >= 0 && u + v <= 1 && r > 1e-9 && r < best.first) best = {r, t};
      }
      const int a = next[0] < next[1] ? (next[0] < next[2] ? 0 : 2) : (next[1] < next[2] ? 1 : 2);
      if (best.first <= next[a]) return best;
      c[a] += step[a];
      if (c[a] < 0 || c[a] >= count_[a]) return best;
      next[a] += width[a];
    }
  }

 private:
  int at(double x, int a) const { return std::clamp(static_cast<int>((x - low_[a]) / cell_), 0, count_[a] - 1); }
  std::size_t index(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(count_[1]) + static_cast<std::size_t>(j)) * static_cast<std::size_t>(count_[0]) + static_cast<std::size_t>(i);
  }
  const Mesh& mesh_;
  double cell_ = 1;
  Vec3 low_;
  int count_[3];
  std::vector<std::vector<int>> cells_;
};

Mesh as_cast(const Part& part, const Options& options, Random& random) {
  Mesh m = part.drawing;
  const Box3 box = part.drawing.box();
  const double scale = 1 + 0.004 * random.normal(), bend = random.uniform(-0.8, 0.8) / (90.0 * 90.0);
  for (Vec3& v : m.vertices) {
    const Vec3 off = v - box.center_mm();
    v = box.center_mm() + scale * off + Vec3(0, 0, bend * off.x() * off.x());
  }
  if (!options.has_extra) return m;
  for (const auto& r : part.risers) extrude(circle(r[0], r[1], r[3]), r[2] - 1, r[2] + random.uniform(25, 55), false, m);
  // Flash: a torn fin out of the outline at the parting plane.
  const std::size_t walls = part.drawing.triangles.size();
  for (std::size_t t = 0; t < walls; ++t) {
    const auto& f = part.drawing.triangles[t];
    for (int e = 0; e < 3; ++e) {
      const Vec3 &a = part.drawing.vertices[static_cast<std::size_t>(f[static_cast<std::size_t>(e)])], &b = part.drawing.vertices[static_cast<std::size_t>(f[static_cast<std::size_t>((e + 1) % 3)])];
      if (std::abs(a.z()) > 1e-6 || std::abs(b.z()) > 1e-6 || std::abs(part.drawing.triangle_normal(static_cast<int>(t)).z()) > 0.1) continue;
      if ((a - b).norm() < 1 || random.uniform() < 0.25) continue;
      const Vec3 n = part.drawing.triangle_normal(static_cast<int>(t)), up(0, 0, part.parting_z_mm);
      const double w1 = random.uniform(1, 4), w2 = random.uniform(1, 4);
      const int first = static_cast<int>(m.vertices.size());
      for (const Vec3& v : {Vec3(a + up), Vec3(b + up), Vec3(b + up + w2 * n), Vec3(a + up + w1 * n)}) m.vertices.push_back(v);
      m.triangles.push_back({first, first + 1, first + 2}), m.triangles.push_back({first, first + 2, first + 3});
    }
  }
  return m;
}

}  // namespace

std::vector<Part> parts() {
  std::vector<Part> all(4);
  {
    Part& p = all[0];
    p.name = "asymmetric";
    extrude({{-95, -45}, {60, -45}, {80, -20}, {80, 30}, {30, 30}, {30, 62}, {-20, 62}, {-20, 20}, {-95, 20}}, 0, 30, true, p.drawing);
    extrude(box(-85, -35, -45, 5), 30, 62, false, p.drawing), extrude(circle(5, -5, 18), 30, 45, false, p.drawing);
    p.parting_z_mm = 15, p.risers = {{{50, 5, 30, 14}}};
  }
  {
    Part& p = all[1];
    p.name = "housing";
    extrude(box(-90, -60, 90, 60), 0, 55, true, p.drawing);
    extrude(circle(-45, 0, 32), 55, 80, false, p.drawing), extrude(circle(50, 20, 20), 55, 70, false, p.drawing);
    extrude(box(30, -50, 75, -20), 55, 64, false, p.drawing), extrude(box(90, -25, 108, 5), 10, 45, true, p.drawing);
    p.parting_z_mm = 27, p.risers = {{{0, 40, 55, 20}}, {{-45, 0, 80, 16}}};
  }
  {
    Part& p = all[2];
    p.name = "near-symmetric";
    extrude(box(-80, -50, 80, 50), 0, 25, true, p.drawing);
    extrude(circle(-50, 0, 22), 25, 50, false, p.drawing), extrude(circle(50, 0, 22), 25, 50, false, p.drawing);
    extrude(box(-10, 20, 10, 40), 25, 39, false, p.drawing);
    p.parting_z_mm = 12, p.risers = {{{0, -25, 25, 15}}};
  }
  {
    Part& p = all[3];
    p.name = "flange";
    extrude(circle(0, 0, 75, 72), 0, 20, true, p.drawing), extrude(circle(0, 0, 38), 20, 70, false, p.drawing);
    for (int i = 0; i < 4; ++i) extrude(circle(57 * std::cos(kPi / 4 + i * kPi / 2), 57 * std::sin(kPi / 4 + i * kPi / 2), 12), 20, 28, false, p.drawing);
    extrude(box(68, -14, 92, 14), 2, 18, true, p.drawing);
    p.parting_z_mm = 10, p.risers = {{{0, 0, 70, 20}}};
  }
  return all;
}

std::vector<Part> drawn_parts(std::uint64_t seed) {
  Random random = Random::stream(seed, "casting parts");
  const auto u = [&](double low, double high) { return random.uniform(low, high); };
  std::vector<Part> all(4);
  {  // a stepped outline with a block, a round boss and a rib, each where it falls
    Part& p = all[0];
    p.name = "asymmetric-" + std::to_string(seed);
    const double a = u(70, 105), b = u(35, 55), h = u(22, 38), cut = u(0.3, 0.6) * a, step = u(12, 28);
    extrude({{-a, -b}, {a, -b}, {a, b - step}, {a - cut, b - step}, {a - cut, b + u(8, 20)}, {-0.3 * a, b + u(0, 6)}, {-a, 0.4 * b}}, 0, h, true, p.drawing);
    const double x = u(-0.8, -0.4) * a, y = u(-0.6, -0.2) * b;
    extrude(box(x - u(10, 22), y - u(8, 15), x + u(10, 22), y + u(8, 15)), h, h + u(15, 35), false, p.drawing);
    extrude(circle(u(0.1, 0.3) * a, u(-0.4, 0.0) * b, u(12, 20)), h, h + u(10, 22), false, p.drawing);
    extrude(box(0.55 * a, -0.8 * b, 0.55 * a + u(6, 10), -0.1 * b), h, h + u(8, 16), false, p.drawing);
    p.parting_z_mm = 0.5 * h, p.risers = {{{0.8 * a, -0.4 * b, h, u(8, 13)}}};
  }
  {  // a housing
    Part& p = all[1];
    p.name = "housing-" + std::to_string(seed);
    const double a = u(75, 100), b = u(48, 68), h = u(42, 65), r = u(24, 34), top = h + u(18, 30);
    extrude(box(-a, -b, a, b), 0, h, true, p.drawing);
    extrude(circle(-0.5 * a, u(-8, 8), r), h, top, false, p.drawing);
    extrude(circle(u(0.45, 0.65) * a, u(0.25, 0.45) * b, u(14, 22)), h, h + u(10, 20), false, p.drawing);
    extrude(box(0.25 * a, -0.85 * b, 0.85 * a, -0.4 * b), h, h + u(7, 14), false, p.drawing);
    extrude(box(a, u(-30, -18), a + u(12, 22), u(0, 12)), 8, h - 8, true, p.drawing);
    p.parting_z_mm = 0.5 * h, p.risers = {{{0, 0.6 * b, h, u(14, 20)}}, {{-0.5 * a, 0, top, 0.5 * r}}};
  }
  {  // a plate with two equal bosses, one small block keeps it from being symmetric
    Part& p = all[2];
    p.name = "near-symmetric-" + std::to_string(seed);
    const double a = u(68, 92), b = u(42, 58), h = u(20, 30), r = u(17, 24), up = h + u(18, 30), side = u(8, 12), y = u(0.5, 0.65) * b;
    extrude(box(-a, -b, a, b), 0, h, true, p.drawing);
    for (const double x : {-0.62 * a, 0.62 * a}) extrude(circle(x, 0, r), h, up, false, p.drawing);
    extrude(box(-side, y - side, side, y + side), h, h + u(12, 18), false, p.drawing);
    p.parting_z_mm = 0.5 * h, p.risers = {{{0, -0.5 * b, h, u(10, 15)}}};
  }
  {  // a flange of three to six bolts with one block at its side
    Part& p = all[3];
    p.name = "flange-" + std::to_string(seed);
    const int bolts = 3 + static_cast<int>(random.below(4));
    const double r = u(65, 85), h = u(16, 25), hub = u(26, 36), top = h + u(30, 45), turn = u(0, kPi);
    extrude(circle(0, 0, r, 72), 0, h, true, p.drawing), extrude(circle(0, 0, hub), h, top, false, p.drawing);
    for (int i = 0; i < bolts; ++i)
      extrude(circle(0.5 * (r + hub) * std::cos(turn + 2 * kPi * i / bolts), 0.5 * (r + hub) * std::sin(turn + 2 * kPi * i / bolts), 0.3 * (r - hub)), h, h + u(6, 10), false, p.drawing);
    extrude(box(r - 7, -u(12, 17), r + u(14, 22), u(12, 17)), 2, h - 2, true, p.drawing);
    p.parting_z_mm = 0.5 * h, p.risers = {{{0, 0, top, 0.5 * hub}}};
  }
  return all;
}

std::vector<View> views(std::uint64_t seed, double distance_mm) {
  Random random = Random::stream(seed, "casting views");
  std::vector<View> out;
  for (int a = 0; a < 8; ++a)
    for (const double height : {25.0, 45.0, 70.0}) {
      const double yaw = rad_from_deg(45.0 * a + random.uniform(-10, 10)), up = rad_from_deg(height + random.uniform(-4, 4));
      out.push_back({distance_mm * Vec3(std::cos(up) * std::cos(yaw), std::cos(up) * std::sin(yaw), std::sin(up)), random.uniform(-kPi, kPi)});
    }
  return out;
}

Scan scan(const Part& part, const View& view, const Options& options) {
  Random random = Random::stream(options.seed, "casting scan " + part.name);
  const Mesh mesh = as_cast(part, options, random);
  const Rays rays(mesh);
  const Vec3 center = part.drawing.box().center_mm(), eye = center + view.eye_part;
  const Eigen::Quaterniond q_part_sensor = quat_from_z(-view.eye_part, Eigen::AngleAxisd(view.roll_rad, view.eye_part.normalized()) * Vec3(0.3, 1, 0.1));
  const Pose<frame::Part, frame::Sensor> T_part_sensor(q_part_sensor, eye);
  const int nu = options.columns, nv = options.rows;
  const double pitch = 2 * std::tan(rad_from_deg(20.0)) / nu;
  const Vec3 projector = T_part_sensor.point(Vec3(120, 0, 0));
  std::vector<double> range(static_cast<std::size_t>(nu * nv), 0), white(range.size());
  std::vector<Vec3> direction(range.size());
  for (double& w : white) w = random.normal();
  std::vector<std::array<double, 3>> patches;  // of lost pixels
  double lost = 0;
  while (lost < 0.5 * options.lost_ratio) {
    const double r = random.uniform(6, 25);
    patches.push_back({random.uniform(0, nu), random.uniform(0, nv), r}), lost += kPi * r * r / (nu * nv);
  }
  const auto at = [&](int i, int j) { return static_cast<std::size_t>(j * nu + i); };
  for (int j = 0; j < nv; ++j) {
    for (int i = 0; i < nu; ++i) {
      const Vec3 d_sensor = Vec3((i - 0.5 * nu + 0.5) * pitch, (j - 0.5 * nv + 0.5) * pitch, 1).normalized();
      direction[at(i, j)] = d_sensor;
      const Vec3 d = T_part_sensor.direction(d_sensor);
      const auto [t, triangle] = rays.first(eye, d);
      const double draw = random.uniform(), second = random.uniform(), share = random.uniform();
      if (triangle < 0) continue;
      const Vec3 p = eye + t * d;
      Vec3 n = mesh.triangle_normal(triangle);
      if (n.dot(d) > 0) n = -n;
      const double cosine = -n.dot(d);
      if (draw < 0.5 * options.lost_ratio + (cosine < 0.15 ? 1 : cosine < 0.35 ? 0.4 : 0.03)) continue;
      const Vec3 to_light = (projector - p).normalized();
      if (n.dot(to_light) < 0.1) continue;
      const auto shadow = rays.first(p + 1e-3 * n, to_light);
      if (shadow.second >= 0) continue;  // not lit
      const Vec3 half = (to_light - d).normalized();
      if (n.dot(half) > std::cos(rad_from_deg(5.0)) && second < 0.75) continue;  // the highlight
      bool is_lost = false;
      for (const auto& c : patches) is_lost |= std::hypot(i - c[0], j - c[1]) < c[2];
      if (is_lost) continue;
      double noise = 0, total = 0;
      for (int b = -1; b <= 1; ++b)
        for (int a = -1; a <= 1; ++a) {
          if (i + a < 0 || i + a >= nu || j + b < 0 || j + b >= nv) continue;
          const double w = std::exp(-0.5 * (a * a + b * b));
          noise += w * white[at(i + a, j + b)], total += w * w;
        }
      range[at(i, j)] = t + options.noise_mm * (2 - cosine) * noise / std::sqrt(total);
      const double left = i > 0 ? range[at(i - 1, j)] : 0;
      if (left > 0 && std::abs(left - t) > 3 && draw > 0.7) range[at(i, j)] = share * left + (1 - share) * t;  // mixed
    }
  }
  Scan out;
  out.T_sensor_part = T_part_sensor.inverse();
  const auto point = [&](int i, int j) -> Vec3 { return range[at(i, j)] * direction[at(i, j)]; };
  for (int j = 0; j < nv; ++j)
    for (int i = 0; i < nu; ++i) {
      if (range[at(i, j)] == 0) continue;
      // Normal by least squares over a window of 5 x 5 pixels of about the same depth.
      Vec3 mean = Vec3::Zero();
      Mat3 moment = Mat3::Zero();
      int count = 0;
      const double depth = range[at(i, j)];
      for (int b = -2; b <= 2; ++b)
        for (int a = -2; a <= 2; ++a) {
          if (i + a < 0 || i + a >= nu || j + b < 0 || j + b >= nv || range[at(i + a, j + b)] == 0 || std::abs(range[at(i + a, j + b)] - depth) > 4) continue;
          const Vec3 q = point(i + a, j + b);
          mean += q, moment += q * q.transpose(), ++count;
        }
      Vec3 n = Vec3::Zero();
      if (count >= 8) {
        mean /= count;
        const Eigen::SelfAdjointEigenSolver<Mat3> eig(moment / count - mean * mean.transpose());
        n = eig.eigenvectors().col(0);
        if (n.dot(point(i, j)) > 0) n = -n;
        if (eig.eigenvalues()[0] > 0.25 * eig.eigenvalues()[1]) n.setZero();
      }
      out.p_sensor.push_back(point(i, j)), out.n_sensor.push_back(n);
    }
  return out;
}

}  // namespace asbuilt::casting_scans
