// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/tessellate.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <unordered_map>
#include <unordered_set>

#include "planner/io/step/flat_face.hpp"
#include "planner/io/step/foot_walk.hpp"
#include "planner/io/step/planar_mesh.hpp"

namespace asbuilt::step {
namespace {

constexpr std::size_t kVerticesLimit = 1'000'000;  // of one body; past it faces keep what they have and say how far off they are

struct Step {
  double u = 1e300, v = 1e300;  // parameter steps that keep chord and angle
};

/// Steps by the normal curvature, sampled over the parameter box of the face.
Step curvature_step(const Chart& chart, const Vec2& low, const Vec2& high, const Tolerance& tol) {
  Step s;
  constexpr int n = 4;
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j <= n; ++j) {
      Vec2 w(low.x() + (high.x() - low.x()) * (i + 0.01) / (n + 0.02), low.y() + (high.y() - low.y()) * (j + 0.01) / (n + 0.02));
      if (chart.domain->is_periodic_u && chart.domain->u1 > chart.domain->u0)
        w.x() -= (chart.domain->u1 - chart.domain->u0) * std::floor((w.x() - chart.domain->u0) / (chart.domain->u1 - chart.domain->u0));
      if (chart.domain->is_periodic_v && chart.domain->v1 > chart.domain->v0)
        w.y() -= (chart.domain->v1 - chart.domain->v0) * std::floor((w.y() - chart.domain->v0) / (chart.domain->v1 - chart.domain->v0));
      const SurfaceJet k = evaluate_jet(*chart.surface, w.x(), w.y());
      const Vec3 m = k.du.cross(k.dv);
      if (m.norm() <= 0) continue;
      const Vec3 normal = m.normalized();
      const double l = std::abs(normal.dot(k.duu)), q = std::abs(normal.dot(k.dvv));
      const double nu = k.du.norm(), nv = k.dv.norm();
      if (l > 1e-12) s.u = std::min({s.u, std::sqrt(8 * tol.chord_mm / l), tol.angle_rad * nu / l});
      if (q > 1e-12) s.v = std::min({s.v, std::sqrt(8 * tol.chord_mm / q), tol.angle_rad * nv / q});
    }
  return s;
}

class FaceMesher {
 public:
  FaceMesher(const Body& body, int face, const Tolerance& tol, BodyMesh& mesh) : body_(body), face_(face), tol_(tol), mesh_(mesh) {}

  /// False: the face could not be meshed this way; `why` says what happened.
  bool run(std::string& why) {
    const std::size_t vertices_before = mesh_.vertices.size();
    FaceChart f = flatten_face(body_, face_, tol_, mesh_.vertices);
    const bool ok = f.fault.empty() && (f.is_whole_surface ? whole(f.chart, why) : region(f, why));
    if (!f.fault.empty()) why = f.fault;
    if (!ok) mesh_.vertices.resize(vertices_before);
    return ok;
  }

 private:
  bool is_flipped() const { return !body_.faces[static_cast<std::size_t>(face_)].same_sense; }

  void emit(int a, int b, int c) {
    if (a == b || b == c || c == a) return;
    if (is_flipped()) std::swap(b, c);
    mesh_.triangles.push_back({a, b, c});
    mesh_.face.push_back(face_);
  }

  /// Area and volume integrals over a chart triangle, three-point rule.
  void integrate(const Chart& chart, const Vec2& a, const Vec2& b, const Vec2& c) {
    const double size = 0.5 * ((b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x()));
    const Vec2 m[3] = {(4 * a + b + c) / 6, (a + 4 * b + c) / 6, (a + b + 4 * c) / 6};
    for (const Vec2& q : m) add(chart, q, size / 3);
  }
  void add(const Chart& chart, const Vec2& q, double weight) {
    const Chart::Jet j = chart.at(q);
    const Vec3 n = j.d0.cross(j.d1);
    area_ += weight * n.norm();
    volume_ += weight * n.dot(j.p - mesh_.origin) / 3;
  }
  void store() {
    mesh_.area_mm2[static_cast<std::size_t>(face_)] = area_;
    mesh_.volume_mm3[static_cast<std::size_t>(face_)] = is_flipped() ? -volume_ : volume_;
  }

  /// By what the cells of a grid over the whole surface exceed the tolerances; of large grids every so many-th row and column.
  struct Excess {
    double chord = 0, turn = 0;  // parts of the tolerances
  };
  Excess worst_of_grid(const Chart& chart, int nu, int nv) {
    const SurfaceDomain& d = *chart.domain;
    const auto at = [&](double i, double j) { return Vec2(d.u0 + (d.u1 - d.u0) * i / nu, d.v0 + (d.v1 - d.v0) * j / nv); };
    const int step_u = std::max(1, nu / 150), step_v = std::max(1, nv / 150);
    Excess worst;
    for (int i = 0; i < nu; i += step_u)
      for (int j = 0; j < nv; j += step_v) {
        Vec3 p[2][2], n[2][2];
        for (int k = 0; k < 4; ++k) {
          const Chart::Jet jet = chart.at(at(i + k / 2, j + k % 2));
          p[k / 2][k % 2] = jet.p, n[k / 2][k % 2] = normal_of(jet);
        }
        for (const auto& [x, y] : {std::pair{n[0][0], n[1][0]}, {n[0][0], n[0][1]}, {n[0][0], n[1][1]}})
          if (!x.isZero() && !y.isZero()) worst.turn = std::max(worst.turn, std::atan2(x.cross(y).norm(), x.dot(y)) / tol_.angle_rad);
        const double limit = 0.95 * tol_.chord_mm;
        worst.chord = std::max({worst.chord, off(chart, at(i + 0.5, j + 0.5), 0.5 * (p[0][0] + p[1][1])) / limit,
                                off(chart, at(i + 2 / 3.0, j + 1 / 3.0), (p[0][0] + p[1][0] + p[1][1]) / 3) / limit,
                                off(chart, at(i + 1 / 3.0, j + 2 / 3.0), (p[0][0] + p[0][1] + p[1][1]) / 3) / limit});
      }
    return worst;
  }

  /// A surface without any border: a grid that closes on itself.
  bool whole(Chart& chart, std::string& why) {
    const SurfaceDomain d = *chart.domain;
    const bool closed_v = d.is_periodic_v || (d.is_pole_v0 && d.is_pole_v1), closed_u = d.is_periodic_u || (d.is_pole_u0 && d.is_pole_u1);
    if (!(closed_u && closed_v)) {
      why = "the face has no border and its surface is not closed";
      return false;
    }
    const Step s = curvature_step(chart, {d.u0, d.v0}, {d.u1, d.v1}, tol_);
    // The middle of a cell is off by what both directions leave, so each takes half.
    const auto count = [](double span, double step) {
      return std::clamp(static_cast<int>(std::ceil(1.42 * span / std::max(step, 1e-300))), 6, 1500);
    };
    int nu = count(d.u1 - d.u0, s.u), nv = count(d.v1 - d.v0, s.v);
    for (int round = 0; round < 6; ++round) {
      if (has_closed_form_foot(*chart.surface) && nu < 1500 && nv < 1500) break;  // the steps are exact
      const Excess e = worst_of_grid(chart, nu, nv);  // the curvature may change between the samples the step was taken from
      const double more = 1.02 * std::max(std::sqrt(e.chord), e.turn);
      if (more <= 1.02) break;
      if (nu == 1500 && nv == 1500) {
        mesh_.chord_max_mm = std::max(mesh_.chord_max_mm, e.chord * tol_.chord_mm);
        break;
      }
      nu = std::min(1500, static_cast<int>(std::ceil(nu * more))), nv = std::min(1500, static_cast<int>(std::ceil(nv * more)));
    }
    std::vector<int> id(static_cast<std::size_t>((nu + 1) * (nv + 1)));
    const auto at = [&](int i, int j) -> int& { return id[static_cast<std::size_t>(i * (nv + 1) + j)]; };
    const auto uv = [&](int i, int j) { return Vec2(d.u0 + (d.u1 - d.u0) * i / nu, d.v0 + (d.v1 - d.v0) * j / nv); };
    for (int i = 0; i <= nu; ++i)
      for (int j = 0; j <= nv; ++j) {
        if (i == nu && d.is_periodic_u)
          at(i, j) = at(0, j);
        else if (j == nv && d.is_periodic_v)
          at(i, j) = at(i, 0);
        else if (j == 0 && d.is_pole_v0 && i > 0)
          at(i, j) = at(0, j);
        else if (j == nv && d.is_pole_v1 && i > 0)
          at(i, j) = at(0, j);
        else if (i == 0 && d.is_pole_u0 && j > 0)
          at(i, j) = at(i, 0);
        else if (i == nu && d.is_pole_u1 && j > 0)
          at(i, j) = at(i, 0);
        else
          at(i, j) = static_cast<int>(mesh_.vertices.size()),
                mesh_.vertices.push_back(evaluate_jet(*chart.surface, uv(i, j).x(), uv(i, j).y()).p);
      }
    for (int i = 0; i < nu; ++i)
      for (int j = 0; j < nv; ++j) {
        emit(at(i, j), at(i + 1, j), at(i + 1, j + 1));
        emit(at(i, j), at(i + 1, j + 1), at(i, j + 1));
        integrate(chart, uv(i, j), uv(i + 1, j), uv(i + 1, j + 1));
        integrate(chart, uv(i, j), uv(i + 1, j + 1), uv(i, j + 1));
      }
    store();
    return true;
  }

  bool region(FaceChart& f, std::string& why) {
    Chart& chart = f.chart;
    Vec2 low = Vec2::Constant(1e300), high = Vec2::Constant(-1e300);
    for (const ChartLoop& l : f.loops)
      for (const ChartPoint& p : l) low = low.cwiseMin(p.q), high = high.cwiseMax(p.q);
    bool want_grid = false;
    if (!chart.is_plane && !chart.is_stereographic) {
      Vec2 uv_low = low, uv_high = high;
      if (chart.is_turned) uv_low = {-high.y(), low.x()}, uv_high = {-low.y(), high.x()};
      Step s = curvature_step(chart, uv_low, uv_high, tol_);
      // Near-isometry with a bounded stretch: flat directions take longer triangles.
      const Vec2 mid = 0.5 * (uv_low + uv_high);
      const SurfaceJet j = evaluate_jet(*chart.surface, mid.x(), mid.y());
      const double nu = std::max(j.du.norm(), 1e-12), nv = std::max(j.dv.norm(), 1e-12);
      want_grid = s.u < uv_high.x() - uv_low.x() && s.v < uv_high.y() - uv_low.y();
      is_doubly_curved_ = s.u < 1e200 && s.v < 1e200;
      constexpr double stretch = 8;
      double lu = s.u * nu, lv = s.v * nv;
      if (lu > 1e200 && lv > 1e200) lu = lv = 1;
      lu = std::min(lu, stretch * lv), lv = std::min(lv, stretch * lu);
      s.u = lu / nu, s.v = lv / nv;
      chart.scale = chart.is_turned ? Vec2(1 / s.v, 1 / s.u) : Vec2(1 / s.u, 1 / s.v);
    } else if (chart.is_stereographic) {
      const double r = chart.radius_mm;
      double step = std::min(tol_.angle_rad, r > 0.5 * tol_.chord_mm ? 2 * std::acos(std::max(0.0, 1 - tol_.chord_mm / r)) : 1.0);
      chart.scale = Vec2::Constant(1 / std::max(1e-9, r * step));
      want_grid = true;
    }
    std::vector<Vec2> q;
    std::vector<int> id;
    std::vector<std::array<int, 2>> segments;
    std::vector<std::pair<Vec2, double>> lenses;  // chart middle, signed lens size
    double total = 0;
    for (const ChartLoop& l : f.loops) {
      const int first = static_cast<int>(q.size()), n = static_cast<int>(l.size());
      for (const ChartPoint& p : l) q.push_back(p.q.cwiseProduct(chart.scale)), id.push_back(p.vertex);
      for (int i = 0; i < n; ++i) {
        const int a = first + i, b = first + (i + 1) % n;
        segments.push_back({a, b});
        const Vec2 &qa = q[static_cast<std::size_t>(a)], &qb = q[static_cast<std::size_t>(b)];
        const Vec2 o = q[0];
        total += 0.5 * ((qa - o).x() * (qb - o).y() - (qa - o).y() * (qb - o).x());
        if (l[static_cast<std::size_t>(i)].has_mid) {
          const Vec2 m = l[static_cast<std::size_t>(i)].q_mid.cwiseProduct(chart.scale);
          // Signed area between the chord a-b and the parabola through a, m, b; positive to the right of the walk (outside).
          const double twice = (m.x() - qa.x()) * (qb.y() - qa.y()) - (m.y() - qa.y()) * (qb.x() - qa.x());
          lenses.emplace_back(m, 2.0 / 3.0 * twice);
        }
      }
    }
    is_backwards_ = total < 0;
    if (!(std::abs(total) > 0) || !std::isfinite(total)) {
      why = "the flattened border encloses no area";
      return false;
    }
    PlanarMesh planar;
    merge_equal(q, id, segments);
    crossings_ = planar.build(q, segments);
    if (crossings_ > 0 && wanted_) {
      std::vector<const ChartPoint*> pieces;
      for (const ChartLoop& l : f.loops)
        for (const ChartPoint& p : l) pieces.push_back(&p);
      if (want_samples(q, segments, pieces)) return true;  // this round's triangles are thrown away
    }
    const auto vertex_of = [&](int k) -> int {
      if (static_cast<std::size_t>(k) < id.size()) return id[static_cast<std::size_t>(k)];
      return -1;
    };
    const auto extend = [&] {  // mesh vertices for points the triangulation has and we do not
      for (int k = static_cast<int>(id.size()); k < planar.size(); ++k) {
        q.push_back(planar.point(k));
        id.push_back(static_cast<int>(mesh_.vertices.size()));
        mesh_.vertices.push_back(chart.at(q.back()).p);
      }
    };
    extend();
    if (is_check_) return true;
    if (want_grid && mesh_.vertices.size() < kVerticesLimit) grid(chart, planar, low, high);
    extend();
    PlanarMesh::Inside in = planar.inside();
    if (!chart.is_plane) {
      std::size_t budget =
          std::min<std::size_t>(200'000, mesh_.vertices.size() > kVerticesLimit ? 0 : kVerticesLimit - mesh_.vertices.size());
      for (int round = 0; round < 40; ++round) {
        std::vector<Vec2> more;
        for (std::size_t t = 0; t < in.triangles.size(); ++t) refine(chart, q, id, in.triangles[t], in.is_border[t], more);
        if (more.empty()) break;
        if (!want_grid && mesh_.vertices.size() < kVerticesLimit) {  // curved one way only, but its border does not lead across it
          want_grid = true;
          grid(chart, planar, low, high);
          extend();
          in = planar.inside();
          continue;
        }
        std::sort(more.begin(), more.end(), [](const Vec2& a, const Vec2& b) { return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y(); });
        more.erase(std::unique(more.begin(), more.end(), [](const Vec2& a, const Vec2& b) { return (a - b).norm() < 1e-9; }), more.end());
        if (more.size() > budget) {
          for (const auto& [side, excess] : checked_)
            mesh_.chord_max_mm = std::max(mesh_.chord_max_mm, 0.9 * tol_.chord_mm * static_cast<double>(excess));
          more.resize(budget);
        }
        budget -= more.size();
        planar.insert(more);
        extend();
        in = planar.inside();
        if (budget == 0) break;
      }
    }
    if (in.triangles.empty()) {
      why = "the flattened border encloses no triangles";
      return false;
    }
    for (const auto& t : in.triangles) {
      emit(vertex_of(t[0]), vertex_of(t[1]), vertex_of(t[2]));
      if (chart.is_plane) {
        const Vec2 &a = q[static_cast<std::size_t>(t[0])], &b = q[static_cast<std::size_t>(t[1])], &c = q[static_cast<std::size_t>(t[2])];
        area_ += 0.5 * ((b - a).x() * (c - a).y() - (b - a).y() * (c - a).x());
      } else {
        integrate(chart, q[static_cast<std::size_t>(t[0])], q[static_cast<std::size_t>(t[1])], q[static_cast<std::size_t>(t[2])]);
      }
    }
    // A loop walked the wrong way round (interior on the right) would turn the sign of the lenses.
    const double sign = total > 0 ? 1 : -1;
    if (chart.is_plane) {
      for (const auto& [m, size] : lenses) area_ += sign * size;
      const auto& at = std::get<PlaneSurface>(chart.surface->shape).at;
      volume_ = area_ * at.z.dot(at.origin - mesh_.origin) / 3;
    } else {
      for (const auto& [m, size] : lenses) add(chart, m, sign * size);
    }
    store();
    return true;
  }

  /// Pieces that cross or touch: each edge gets the feet of the other's ends as samples, so that near-parallel borders run alike.
  bool want_samples(const std::vector<Vec2>& q, const std::vector<std::array<int, 2>>& segments,
                    const std::vector<const ChartPoint*>& pieces) {
    const auto side = [](const Vec2& a, const Vec2& b, const Vec2& c) { return (b - a).x() * (c - a).y() - (b - a).y() * (c - a).x(); };
    std::vector<std::size_t> order(segments.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    const auto end = [&](std::size_t i, int k) -> const Vec2& {
      return q[static_cast<std::size_t>(segments[i][static_cast<std::size_t>(k)])];
    };
    const auto low = [&](std::size_t i) { return std::min(end(i, 0).x(), end(i, 1).x()); };
    const auto high = [&](std::size_t i) { return std::max(end(i, 0).x(), end(i, 1).x()); };
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return low(a) != low(b) ? low(a) < low(b) : a < b; });
    std::size_t pairs = 0;
    for (std::size_t x = 0; x < order.size(); ++x)
      for (std::size_t y = x + 1; y < order.size() && low(order[y]) <= high(order[x]) && pairs < 100000; ++y) {
        const std::size_t i = order[x], j = order[y];
        if (std::min(end(i, 0).y(), end(i, 1).y()) > std::max(end(j, 0).y(), end(j, 1).y()) ||
            std::min(end(j, 0).y(), end(j, 1).y()) > std::max(end(i, 0).y(), end(i, 1).y()))
          continue;
        int shared = 0;
        for (int a : segments[i])
          for (int b : segments[j]) shared += a == b;
        if (shared > 1) continue;
        const double d1 = side(end(i, 0), end(i, 1), end(j, 0)), d2 = side(end(i, 0), end(i, 1), end(j, 1));
        const double d3 = side(end(j, 0), end(j, 1), end(i, 0)), d4 = side(end(j, 0), end(j, 1), end(i, 1));
        const bool cross = d1 * d2 <= 0 && d3 * d4 <= 0;
        if (!cross || (shared == 1 && !(d1 * d2 == 0 && d3 * d4 == 0 && d1 + d2 == 0))) continue;
        ++pairs;
        want(*pieces[i], *pieces[j]);
        want(*pieces[j], *pieces[i]);
      }
    return wanted_count_ > 0;
  }
  void want(const ChartPoint& onto, const ChartPoint& from) {
    if (onto.edge < 0 || from.edge < 0) return;
    const TopoEdge &a = body_.edges[static_cast<std::size_t>(onto.edge)], &b = body_.edges[static_cast<std::size_t>(from.edge)];
    const double lo = std::min(onto.t_a, onto.t_b), hi = std::max(onto.t_a, onto.t_b);
    bool any = false;
    for (double t : {from.t_a, from.t_b}) {
      double s = project(a.curve, evaluate(b.curve, t).p, 0.5 * (lo + hi)).t;
      const CurveDomain d = asbuilt::domain(a.curve);
      if (d.is_closed) s += d.period() * std::round((0.5 * (lo + hi) - s) / d.period());
      if (s > lo + 1e-3 * (hi - lo) && s < hi - 1e-3 * (hi - lo)) (*wanted_)[static_cast<std::size_t>(onto.edge)].push_back(s), any = true;
    }
    if (!any && onto.edge != from.edge) (*wanted_)[static_cast<std::size_t>(onto.edge)].push_back(0.5 * (lo + hi)), any = true;
    wanted_count_ += any;
  }

  /// Equal chart points become one.
  static void merge_equal(std::vector<Vec2>& q, std::vector<int>& id, std::vector<std::array<int, 2>>& segments) {
    std::vector<int> order(q.size()), alias(q.size());
    for (std::size_t i = 0; i < q.size(); ++i) order[i] = static_cast<int>(i);
    std::sort(order.begin(), order.end(), [&](int a, int b) {
      const Vec2 &x = q[static_cast<std::size_t>(a)], &y = q[static_cast<std::size_t>(b)];
      return x.x() != y.x() ? x.x() < y.x() : x.y() != y.y() ? x.y() < y.y() : a < b;
    });
    std::vector<int> root(q.size());
    for (std::size_t k = 0; k < order.size(); ++k) {
      const auto i = static_cast<std::size_t>(order[k]);
      root[i] = order[k];
      if (k > 0 && q[i] == q[static_cast<std::size_t>(order[k - 1])]) root[i] = root[static_cast<std::size_t>(order[k - 1])];
    }
    std::vector<Vec2> q2;
    std::vector<int> id2;
    for (std::size_t i = 0; i < q.size(); ++i)
      if (root[i] == static_cast<int>(i)) alias[i] = static_cast<int>(q2.size()), q2.push_back(q[i]), id2.push_back(id[i]);
    for (std::size_t i = 0; i < q.size(); ++i) alias[i] = alias[static_cast<std::size_t>(root[i])];
    for (auto& s : segments) s = {alias[static_cast<std::size_t>(s[0])], alias[static_cast<std::size_t>(s[1])]};
    q = std::move(q2), id = std::move(id2);
  }

  void grid(const Chart& chart, PlanarMesh& planar, const Vec2& low, const Vec2& high) const {
    const Vec2 a = low.cwiseProduct(chart.scale), b = high.cwiseProduct(chart.scale);
    double step = is_doubly_curved_ ? 0.75 : 1;  // the middle of a cell is off by what both directions leave
    while ((b.x() - a.x()) / step * ((b.y() - a.y()) / step) > 60000) step *= 1.5;
    std::vector<Vec2> points;
    int row = 0;
    for (double y = a.y() + 0.5 * step; y < b.y(); y += step, ++row)
      for (double x = a.x() + (row % 2 ? 0.5 : 1.0) * step; x < b.x(); x += step) points.push_back({x, y});
    planar.insert(planar.filter_inside(points, 0.45 * step));
  }

  /// Points where the triangle leaves the surface by more than the chord tolerance, or the normal turns by more than the angle.
  /// Sides and centres are looked at; what lies between them is at most a tenth further off.
  void refine(const Chart& chart, const std::vector<Vec2>& q, const std::vector<int>& id, const std::array<int, 3>& t,
              const std::array<bool, 3>& is_border, std::vector<Vec2>& more) {
    const double limit = 0.9 * tol_.chord_mm;
    double worst = 1;
    Vec2 pick;
    bool found = false;
    for (int k = 0; k < 3; ++k) {
      const auto a = static_cast<std::size_t>(t[static_cast<std::size_t>(k)]),
                 b = static_cast<std::size_t>(t[static_cast<std::size_t>((k + 1) % 3)]);
      if (is_border[static_cast<std::size_t>(k)] || id[a] == id[b]) continue;
      const std::uint64_t key = static_cast<std::uint64_t>(std::min(a, b)) << 32 | std::max(a, b);
      const auto [it, first] = checked_.emplace(key, 0.0f);
      if (first) {
        const Vec2 m = 0.5 * (q[a] + q[b]);
        const double far =
            off(chart, m, 0.5 * (mesh_.vertices[static_cast<std::size_t>(id[a])] + mesh_.vertices[static_cast<std::size_t>(id[b])])) /
            limit;
        it->second = static_cast<float>(std::max(far, turn(chart, q, a, b) / tol_.angle_rad));
      }
      if (it->second > worst) worst = it->second, pick = 0.5 * (q[a] + q[b]), found = true;
    }
    const auto a = static_cast<std::size_t>(t[0]), b = static_cast<std::size_t>(t[1]), c = static_cast<std::size_t>(t[2]);
    if (!found &&
        good_.insert(std::min({a, b, c}) * 0x9E3779B97F4A7C15ull ^ std::max({a, b, c}) * 0xC2B2AE3D27D4EB4Full ^ (a + b + c)).second) {
      if (id[a] == id[b] || id[b] == id[c] || id[c] == id[a]) return;
      const Vec2 m = (q[a] + q[b] + q[c]) / 3;
      const Vec3 p = (mesh_.vertices[static_cast<std::size_t>(id[a])] + mesh_.vertices[static_cast<std::size_t>(id[b])] +
                      mesh_.vertices[static_cast<std::size_t>(id[c])]) /
                     3;
      if (off(chart, m, p) > limit) pick = m, found = true;
    }
    if (found) more.push_back(pick);
  }
  static Vec3 normal_of(const Chart::Jet& j) {
    const Vec3 n = j.d0.cross(j.d1);
    const double l = n.norm();
    return l > 1e-6 * std::max(j.d0.squaredNorm(), j.d1.squaredNorm()) ? Vec3(n / l) : Vec3::Zero();
  }
  /// The normal of chart point k that counts on the way to q_b: its own, or the one kNormalReach_mm inside where it has none.
  Vec3 normal_towards(const Chart& chart, std::size_t k, const Vec2& q_a, const Vec2& q_b) {
    const Vec3 own = normals_[k], near = normal_of(chart.at(q_a + 1e-3 * (q_b - q_a)));
    if (!own.isZero() && own.dot(near) > std::cos(0.05 * tol_.angle_rad)) return own;  // as on almost every surface
    const Vec3 p_a = chart.at(q_a).p, p_b = chart.at(q_b).p, p = p_a + kNormalReach_mm / (p_b - p_a).norm() * (p_b - p_a);
    if (!walk_) walk_.emplace(*chart.surface, *chart.domain);
    const SurfaceFoot g = walk_->at(p, chart.uv(q_a));
    const Vec3 inside = normal_of(chart.at(chart.q({g.u, g.v})));
    return is_settled(own, inside, tol_.angle_rad) ? own : inside;
  }
  /// Angle between the normals at two chart points; where an end has none of its own, the normal a little inside counts.
  double turn(const Chart& chart, const std::vector<Vec2>& q, std::size_t a, std::size_t b) {
    if (normals_.size() < q.size()) normals_.resize(q.size(), Vec3::Constant(2));
    for (std::size_t k : {a, b})
      if (normals_[k].x() == 2) normals_[k] = normal_of(chart.at(q[k]));
    const auto between = [](const Vec3& x, const Vec3& y) {
      return x.isZero() || y.isZero() ? 0 : std::atan2(x.cross(y).norm(), x.dot(y));
    };
    const double turn = between(normals_[a], normals_[b]);
    if (chart.is_stereographic || (turn <= tol_.angle_rad && !normals_[a].isZero() && !normals_[b].isZero())) return turn;
    if ((chart.at(q[b]).p - chart.at(q[a]).p).norm() < 2 * kNormalReach_mm) return 0;
    return between(normal_towards(chart, a, q[a], q[b]), normal_towards(chart, b, q[b], q[a]));
  }
  double off(const Chart& chart, const Vec2& m, const Vec3& p) const {
    const Chart::Jet j = chart.at(m);
    const Vec3 n = j.d0.cross(j.d1);
    const double l = n.norm();
    return l > 0 ? std::abs(n.dot(j.p - p)) / l : 0;
  }

  const Body& body_;
  int face_;
  Tolerance tol_;
  BodyMesh& mesh_;
  double area_ = 0, volume_ = 0;
  int wanted_count_ = 0;
  bool is_doubly_curved_ = false;
  std::unordered_map<std::uint64_t, float> checked_;  // side -> what it exceeds the tolerances by
  std::unordered_set<std::uint64_t> good_;            // triangles whose centre has been looked at
  std::optional<FootWalk> walk_;
  std::vector<Vec3> normals_;  // of chart points; 2, 2, 2: not yet known

 public:
  int crossings_ = 0;
  std::map<std::size_t, std::vector<double>>* wanted_ = nullptr;  // edge -> parameters; null in the last round
  bool is_backwards_ = false;                                     // the loops run with the interior on the right
  bool is_check_ = false;                                         // borders only: no triangles are made
};

/// Edges of the face used the other way round by their other face, as in a closed shell they are, less those used the same way.
int agreement_with_neighbours(const Body& body, std::size_t face) {
  int agree = 0, contradict = 0;
  for (const TopoLoop& l : body.faces[face].loops)
    for (const EdgeUse& u : l.uses) {
      const auto& uses = body.edges[static_cast<std::size_t>(u.edge)].uses;
      if (uses.size() != 2 || uses[0].first == uses[1].first) continue;
      ++(uses[0].second != uses[1].second ? agree : contradict);
    }
  return agree - contradict;
}

/// One round; `wanted` collects samples that would keep borders from crossing.
BodyMesh tessellate_once(Body& body, const Tolerance& tol, std::map<std::size_t, std::vector<double>>* wanted, bool is_check) {
  BodyMesh mesh;
  mesh.chord_max_mm = tol.chord_mm;
  sample_edges(body, tol, mesh.vertices);
  Box3 box;
  for (const Vec3& v : mesh.vertices) box.extend(v);
  if (!box.is_empty()) mesh.origin = box.center_mm();
  mesh.area_mm2.assign(body.faces.size(), 0), mesh.volume_mm3.assign(body.faces.size(), 0);
  for (std::size_t k = 0; k < body.faces.size(); ++k) {
    TopoFace& f = body.faces[k];
    std::string why = f.fault;
    if (f.surface >= 0) {
      FaceMesher m(body, static_cast<int>(k), tol, mesh);
      m.wanted_ = wanted, m.is_check_ = is_check;
      why.clear();
      const std::size_t vertices = mesh.vertices.size(), triangles = mesh.triangles.size();
      bool ok = m.run(why);
      const int agreement = ok && m.is_backwards_ ? agreement_with_neighbours(body, k) : 0;
      if (agreement != 0) {  // the sense of the face is wrong, or else its loops
        if (agreement > 0)
          f.same_sense = !f.same_sense;
        else
          reverse_loops(body, static_cast<int>(k));
        FaceMesher again(body, static_cast<int>(k), tol, mesh);
        again.wanted_ = wanted, again.is_check_ = is_check;
        mesh.vertices.resize(vertices), mesh.triangles.resize(triangles), mesh.face.resize(triangles);
        ok = again.run(why);
      }
      if (ok) {
        if (m.crossings_ > 0 && f.fault.empty()) f.fault = "its border crosses itself " + std::to_string(m.crossings_) + " times";
        continue;
      }
    }
    if (is_check) continue;
    if (f.loops.empty() || !flat_fallback(body, static_cast<int>(k), mesh))
      why += "; left out of the mesh";
    else
      why += "; meshed flat";
    f.fault = why;
  }
  return mesh;
}

}  // namespace

BodyMesh tessellate(Body& body, const Tolerance& tol) {
  std::vector<std::string> faults;
  for (const TopoFace& f : body.faces) faults.push_back(f.fault);
  const auto forget = [&] {
    for (std::size_t k = 0; k < body.faces.size(); ++k) body.faces[k].fault = faults[k];
  };
  for (int round = 0; round < 5; ++round) {  // the first and the last with triangles, those between look at borders only
    std::map<std::size_t, std::vector<double>> wanted;
    BodyMesh mesh = tessellate_once(body, tol, &wanted, round > 0);
    if (wanted.empty()) {
      if (round == 0) return mesh;
      break;
    }
    for (const auto& [edge, t] : wanted) {
      auto& extra = body.edges[edge].t_extra;
      extra.insert(extra.end(), t.begin(), t.end());
    }
    forget();
  }
  forget();
  return tessellate_once(body, tol, nullptr, false);
}

}  // namespace asbuilt::step
