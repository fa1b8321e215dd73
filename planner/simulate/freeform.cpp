// SPDX-License-Identifier: GPL-3.0-or-later
// A free-form part: a block whose top is one bicubic B-spline face over a rectangle; its four rims are worked. As made, the poles
// are off by what the mill's deflection leaves (smooth), the sides by their tolerance, and the whole is bent a little.
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "planner/simulate/deformation.hpp"
#include "planner/simulate/files.hpp"
#include "planner/simulate/part_model.hpp"
#include "planner/simulate/step_writer.hpp"

namespace asbuilt::simulate_detail {
namespace {

constexpr double kLength = 120, kWidth = 84, kHeight = 30;
constexpr int kPolesX = 9, kPolesY = 7;

/// Values and slopes of the clamped uniform cubic basis with n functions at t in [0, 1] (Cox, de Boor).
struct BasisRow {
  std::vector<double> value, slope;
};
BasisRow basis(int n, double t) {
  std::vector<double> k(static_cast<std::size_t>(n) + 4);
  for (int i = 0; i < n + 4; ++i) k[i] = std::clamp(static_cast<double>(i - 3) / (n - 3), 0.0, 1.0);
  const std::function<double(int, int)> b = [&](int i, int p) -> double {
    if (p == 0) return (t >= k[i] && t < k[i + 1]) || (t >= 1 && k[i] < 1 && k[i + 1] >= 1) ? 1.0 : 0.0;
    double v = 0;
    if (k[i + p] > k[i]) v += (t - k[i]) / (k[i + p] - k[i]) * b(i, p - 1);
    if (k[i + p + 1] > k[i + 1]) v += (k[i + p + 1] - t) / (k[i + p + 1] - k[i + 1]) * b(i + 1, p - 1);
    return v;
  };
  BasisRow out;
  for (int i = 0; i < n; ++i) {
    out.value.push_back(b(i, 3));
    double d = 0;
    if (k[i + 3] > k[i]) d += 3 / (k[i + 3] - k[i]) * b(i, 2);
    if (k[i + 4] > k[i + 1]) d -= 3 / (k[i + 4] - k[i + 1]) * b(i + 1, 2);
    out.slope.push_back(d);
  }
  return out;
}
/// Where pole i of n has to stand for the coordinate to be linear in the parameter.
double greville(int n, int i) {
  double sum = 0;
  for (int j = 1; j <= 3; ++j) sum += std::clamp(static_cast<double>(i + j - 3) / (n - 3), 0.0, 1.0);
  return sum / 3;
}

/// z over the rectangle [-length / 2, length / 2] x [-width / 2, width / 2].
struct Top {
  std::array<std::array<double, kPolesY>, kPolesX> z;
  struct Value {
    double z, dx, dy;
  };
  Value at(double x, double y) const {
    const double u = std::clamp(x / kLength + 0.5, 0.0, 1.0), v = std::clamp(y / kWidth + 0.5, 0.0, 1.0);
    const BasisRow bu = basis(kPolesX, u), bv = basis(kPolesY, v);
    Value out{0, 0, 0};
    for (int i = 0; i < kPolesX; ++i)
      for (int j = 0; j < kPolesY; ++j) {
        out.z += bu.value[i] * bv.value[j] * z[i][j];
        out.dx += bu.slope[i] * bv.value[j] * z[i][j] / kLength, out.dy += bu.value[i] * bv.slope[j] * z[i][j] / kWidth;
      }
    // past the rectangle the face goes on straight
    out.z += out.dx * (x - (u - 0.5) * kLength) + out.dy * (y - (v - 0.5) * kWidth);
    return out;
  }
};
double pole_x(int i) { return (greville(kPolesX, i) - 0.5) * kLength; }
double pole_y(int j) { return (greville(kPolesY, j) - 0.5) * kWidth; }

struct Side {
  Vec3 n;
  double d;
};
struct Block {
  Top top;
  std::array<Side, 4> sides;  // -y, +x, +y, -x: counter-clockwise
};

Vec3 corner(const Block& b, int k, int l) {  // of sides k and l with the top
  Vec3 p = kLength / 2 * (std::abs(b.sides[k].n.x()) > 0.5 ? b.sides[k].n : b.sides[l].n) +
           kWidth / 2 * (std::abs(b.sides[k].n.y()) > 0.5 ? b.sides[k].n : b.sides[l].n);
  for (int i = 0; i < 20; ++i) {
    const Top::Value t = b.top.at(p.x(), p.y());
    p.z() = t.z;
    Eigen::Matrix2d m;
    Eigen::Vector2d f;
    for (int r = 0; r < 2; ++r) {
      const Side& s = b.sides[r == 0 ? k : l];
      m(r, 0) = s.n.x() + s.n.z() * t.dx, m(r, 1) = s.n.y() + s.n.z() * t.dy;
      f[r] = s.n.dot(p) - s.d;
    }
    const Eigen::Vector2d step = m.inverse() * f;
    p.x() -= step.x(), p.y() -= step.y();
  }
  p.z() = b.top.at(p.x(), p.y()).z;
  return p;
}

/// Rim k from its first corner to its second, n + 1 points.
std::vector<Vec3> rim(const Block& b, int k, int n) {
  const Vec3 from = corner(b, (k + 3) % 4, k), to = corner(b, k, (k + 1) % 4);
  const Side& s = b.sides[k];
  const int across = std::abs(s.n.x()) > 0.5 ? 0 : 1;
  std::vector<Vec3> out;
  for (int i = 0; i <= n; ++i) {
    Vec3 p = from + (to - from) * (static_cast<double>(i) / n);
    for (int it = 0; it < 20 && i > 0 && i < n; ++it) {
      const Top::Value t = b.top.at(p.x(), p.y());
      p.z() = t.z;
      p[across] -= (s.n.dot(p) - s.d) / (s.n[across] + s.n.z() * (across == 0 ? t.dx : t.dy));
    }
    p.z() = b.top.at(p.x(), p.y()).z;
    out.push_back(p);
  }
  return out;
}

Mesh mesh_of(const Block& b, double step) {
  const int nx = static_cast<int>(std::ceil(kLength / step)), ny = static_cast<int>(std::ceil(kWidth / step)), nz = static_cast<int>(std::ceil(kHeight / step));
  const std::array<std::vector<Vec3>, 4> rims{rim(b, 0, nx), rim(b, 1, ny), rim(b, 2, nx), rim(b, 3, ny)};
  Mesh m;
  for (int j = 0; j <= ny; ++j)
    for (int i = 0; i <= nx; ++i) {
      const double u = static_cast<double>(i) / nx, v = static_cast<double>(j) / ny;
      const Vec3 &s = rims[0][i], &n = rims[2][nx - i], &e = rims[1][j], &w = rims[3][ny - j];
      const Vec3 flat = (1 - u) * (1 - v) * rims[0][0] + u * (1 - v) * rims[1][0] + u * v * rims[2][0] + (1 - u) * v * rims[3][0];
      Vec3 p = (1 - v) * s + v * n + (1 - u) * w + u * e - flat;
      p.z() = b.top.at(p.x(), p.y()).z;
      m.vertices.push_back(p);
    }
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) {
      const int a = j * (nx + 1) + i, d = a + nx + 1;
      m.triangles.push_back({a, a + 1, d + 1}), m.triangles.push_back({a, d + 1, d});
    }
  for (int k = 0; k < 4; ++k) {
    const Side& s = b.sides[k];
    const int across = std::abs(s.n.x()) > 0.5 ? 0 : 1, base = static_cast<int>(m.vertices.size()), n = static_cast<int>(rims[k].size());
    for (int l = 0; l <= nz; ++l)
      for (const Vec3& top : rims[k]) {
        Vec3 p = top;
        p.z() = top.z() * l / nz;
        p[across] += (s.d - s.n.dot(p)) / s.n[across];
        m.vertices.push_back(p);
      }
    for (int l = 0; l < nz; ++l)
      for (int i = 0; i + 1 < n; ++i) {
        const int a = base + l * n + i;
        m.triangles.push_back({a, a + 1, a + n + 1}), m.triangles.push_back({a, a + n + 1, a + n});
      }
  }
  append(m, box_mesh(Vec3(-kLength / 2 + 0.5, -kWidth / 2 + 0.5, 0), Vec3(kLength / 2 - 0.5, kWidth / 2 - 0.5, 1)));  // the underside
  return m;
}

std::vector<TrueEdge> rims_of(const Block& b, const Deformation& d, double step) {
  std::vector<TrueEdge> out;
  for (int k = 0; k < 4; ++k) {
    TrueEdge e;
    e.feature = "rim", e.id = "rim-" + std::to_string(k);
    const int n = static_cast<int>(std::ceil((k % 2 == 0 ? kLength : kWidth) / step));
    for (const Vec3& p : rim(b, k, n)) {
      const Top::Value t = b.top.at(p.x(), p.y());
      const Vec3 up = Vec3(-t.dx, -t.dy, 1).normalized();
      e.p.push_back(d.point(p));
      e.n_1.push_back(d.normal(p, up)), e.n_2.push_back(d.normal(p, b.sides[k].n));
      e.tangent.push_back((d.gradient(p) * up.cross(b.sides[k].n)).normalized());
      if (const Vec3 along = Vec3(-b.sides[k].n.y(), b.sides[k].n.x(), 0); e.tangent.back().dot(along) < 0) e.tangent.back() *= -1;
      e.s_mm.push_back(e.s_mm.empty() ? 0.0 : e.s_mm.back() + (e.p.back() - e.p[e.p.size() - 2]).norm());
    }
    out.push_back(std::move(e));
  }
  return out;
}

std::string step_of(const Top& top) {
  StepWriter w;
  const auto pole = [&](int i, int j) { return Vec3(pole_x(i), pole_y(j), top.z[i][j]); };
  std::vector<std::vector<Vec3>> poles(kPolesX);
  for (int i = 0; i < kPolesX; ++i)
    for (int j = 0; j < kPolesY; ++j) poles[i].push_back(pole(i, j));
  std::array<std::vector<Vec3>, 4> runs;  // counter-clockwise
  for (int i = 0; i < kPolesX; ++i) runs[0].push_back(pole(i, 0)), runs[2].push_back(pole(kPolesX - 1 - i, kPolesY - 1));
  for (int j = 0; j < kPolesY; ++j) runs[1].push_back(pole(kPolesX - 1, j)), runs[3].push_back(pole(0, kPolesY - 1 - j));
  std::array<int, 4> rims, lows, risers;
  const auto ground = [](Vec3 p) { return p.z() = 0, p; };
  for (int k = 0; k < 4; ++k) {
    rims[k] = w.spline_edge(runs[k]);
    lows[k] = w.line_edge(ground(runs[k].front()), ground(runs[k].back()));
    risers[k] = w.line_edge(ground(runs[k].front()), runs[k].front());
  }
  const Vec3 normal[4] = {-Vec3::UnitY(), Vec3::UnitX(), Vec3::UnitY(), -Vec3::UnitX()};
  for (int k = 0; k < 4; ++k) {
    const int loop = w.loop({{lows[k], true}, {risers[(k + 1) % 4], true}, {rims[k], false}, {risers[k], false}});
    w.face(w.plane(ground(runs[k].front()), normal[k]), true, {loop});
  }
  w.face(w.spline_surface(poles), true, {w.loop({{rims[0], true}, {rims[1], true}, {rims[2], true}, {rims[3], true}})});
  w.face(w.plane(Vec3::Zero(), -Vec3::UnitZ()), true, {w.loop({{lows[3], false}, {lows[2], false}, {lows[1], false}, {lows[0], false}})});
  return w.finish("freeform");
}

}  // namespace

PartModel make_freeform(Random& random) {
  Block drawn;
  for (int i = 0; i < kPolesX; ++i)
    for (int j = 0; j < kPolesY; ++j) {
      const double x = pole_x(i), y = pole_y(j);
      drawn.top.z[i][j] = kHeight + 4.5 * std::sin(0.026 * x + 0.3) + 2.2 * std::cos(0.035 * y) + 1.0 * std::sin(0.03 * x - 0.04 * y);
    }
  const double h[4] = {kWidth / 2, kLength / 2, kWidth / 2, kLength / 2};
  const Vec3 n[4] = {-Vec3::UnitY(), Vec3::UnitX(), Vec3::UnitY(), -Vec3::UnitX()};
  for (int k = 0; k < 4; ++k) drawn.sides[k] = {n[k], h[k]};

  Block made = drawn;
  const double shift = random.normal(0, 0.10), a = random.normal(0, 0.08), phase = random.uniform(0, 2 * kPi), wave = random.uniform(0.02, 0.05);
  for (int i = 0; i < kPolesX; ++i)
    for (int j = 0; j < kPolesY; ++j)
      made.top.z[i][j] += shift + a * std::sin(wave * (pole_x(i) + 0.7 * pole_y(j)) + phase) + random.normal(0, 0.02);
  for (Side& s : made.sides) {
    const Vec3 middle = s.n * s.d + Vec3(0, 0, kHeight);
    s.n = (quat_exp(Vec3(random.normal(), random.normal(), random.normal()) * 0.0010) * s.n).normalized();
    s.d = s.n.dot(middle) + random.normal(0, 0.10);
  }
  Deformation d;
  add_waves(d, 6, random.uniform(0.02, 0.08), 120, 400, random);

  PartModel part;
  part.step = step_of(drawn.top);
  part.drawn = mesh_of(drawn, 2.0), part.made = mesh_of(made, 1.5);
  for (Vec3& v : part.made.vertices) v = d.point(v);
  part.drawn_edges = rims_of(drawn, {}, 0.25), part.made_edges = rims_of(made, d, 0.25);
  part.features = {"rim"};
  part.look_at = Vec3(0, 0, 20), part.support_mm = Vec3(48, 30, 0);
  part.material = "AlSi1MgMn";
  return part;
}

}  // namespace asbuilt::simulate_detail
