// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/chart.hpp"

#include <algorithm>
#include <cmath>

#include "planner/io/step/lift.hpp"

namespace asbuilt::step {
namespace {

double signed_area(const Lifted& l) {
  double a = 0;
  for (std::size_t i = 0; i < l.size(); ++i) {
    const Vec2 p = l[i].uv - l[0].uv, q = l[(i + 1) % l.size()].uv - l[0].uv;
    a += p.x() * q.y() - p.y() * q.x();
  }
  return 0.5 * a;
}

bool contains(const Lifted& l, const Vec2& p) {
  bool in = false;
  for (std::size_t i = 0, j = l.size() - 1; i < l.size(); j = i++) {
    const Vec2 &a = l[i].uv, &b = l[j].uv;
    if ((a.y() > p.y()) != (b.y() > p.y()) && p.x() < (b.x() - a.x()) * (p.y() - a.y()) / (b.y() - a.y()) + a.x()) in = !in;
  }
  return in;
}

void shift(Lifted& l, const Vec2& by) {
  for (LiftedPoint& p : l) p.uv += by, p.uv_mid += by;
}

bool segments_cross(const Vec2& a, const Vec2& b, const Vec2& c, const Vec2& d) {
  const auto side = [](const Vec2& p, const Vec2& q, const Vec2& r) {
    return (q.x() - p.x()) * (r.y() - p.y()) - (q.y() - p.y()) * (r.x() - p.x());
  };
  const double d1 = side(a, b, c), d2 = side(a, b, d), d3 = side(c, d, a), d4 = side(c, d, b);
  return d1 * d2 <= 0 && d3 * d4 <= 0 && !(d1 == 0 && d2 == 0);
}

void turn_quarter(Lifted& l) {
  for (LiftedPoint& p : l) p.uv = Vec2(p.uv.y(), -p.uv.x()), p.uv_mid = Vec2(p.uv_mid.y(), -p.uv_mid.x());
}

/// The loop once around, starting at point k, with a copy of the start one period on.
Lifted unrolled(const Lifted& l, std::size_t k, double turn) {
  Lifted out;
  for (std::size_t i = 0; i <= l.size(); ++i) {
    LiftedPoint p = l[(k + i) % l.size()];
    if (k + i >= l.size()) p.uv.x() += turn, p.uv_mid.x() += turn;
    out.push_back(p);
  }
  out.back().has_mid = false, out.back().edge = -1;
  return out;
}

/// The loop walked backwards; `turn` is the period it then advances by.
void reverse(Lifted& l, double turn) {
  Lifted out;
  for (std::size_t i = 0; i < l.size(); ++i) {
    LiftedPoint p = l[(l.size() - i) % l.size()];
    const LiftedPoint& piece = l[l.size() - 1 - i];  // the piece that ended here now starts here
    p.has_mid = piece.has_mid, p.uv_mid = piece.uv_mid, p.p_mid = piece.p_mid, p.edge = piece.edge, p.t_a = piece.t_b, p.t_b = piece.t_a;
    if (i > 0) p.uv.x() += turn;
    p.uv_mid.x() += turn;
    out.push_back(p);
  }
  l = std::move(out);
}

struct Builder {
  const Body& body;
  const TopoFace& face;
  const Surface& surface;
  const SurfaceDomain& domain;
  const Tolerance& tolerance;
  std::vector<Vec3>& vertices;
  FaceChart out;

  int new_vertex(const Vec3& p) {
    vertices.push_back(p);
    return static_cast<int>(vertices.size()) - 1;
  }

  /// Points strictly between two chart positions, as new mesh vertices on the surface.
  Lifted seam(const Vec2& from, const Vec2& to, bool is_turned, int steps) {
    Lifted l;
    for (int i = 1; i < steps; ++i) {
      LiftedPoint p;
      p.uv = from + (to - from) * i / steps;
      const Vec2 uv = is_turned ? Vec2(-p.uv.y(), p.uv.x()) : p.uv;
      p.p = out.chart.at(out.chart.q(uv)).p;
      p.vertex = new_vertex(p.p);
      l.push_back(p);
    }
    return l;
  }

  /// How many pieces a straight cut needs so that its chords and the turns of the normal stay within the tolerances.
  int seam_steps(const Vec2& from, const Vec2& to, bool is_turned) {
    const auto at = [&](double f) {
      const Vec2 w = from + (to - from) * f;
      return out.chart.at(out.chart.q(is_turned ? Vec2(-w.y(), w.x()) : w));
    };
    const auto normal = [](const Chart::Jet& j) {
      const Vec3 n = j.d0.cross(j.d1);
      return n.norm() > 1e-6 * std::max(j.d0.squaredNorm(), j.d1.squaredNorm()) ? Vec3(n.normalized()) : Vec3(Vec3::Zero());
    };
    int n = 1;
    while (n < 256) {
      bool is_fine = true;
      for (int i = 0; i < n && is_fine; ++i) {
        const Chart::Jet a = at(double(i) / n), b = at((i + 1.0) / n), m = at((i + 0.5) / n);
        const Vec3 chord = b.p - a.p, n_a = normal(a), n_b = normal(b);
        const double l = chord.norm(), off = l > 0 ? (m.p - a.p).cross(chord).norm() / l : (m.p - a.p).norm();
        const double turn = n_a.isZero() || n_b.isZero() ? 0 : std::atan2(n_a.cross(n_b).norm(), n_a.dot(n_b));
        is_fine = off <= tolerance.chord_mm && turn <= tolerance.angle_rad;
      }
      if (is_fine) break;
      n *= 2;
    }
    return n;
  }

  void push(std::vector<Lifted>& loops) {
    for (const Lifted& l : loops) {
      ChartLoop c;
      for (const LiftedPoint& p : l) c.push_back({p.uv, p.vertex, p.uv_mid, p.has_mid, p.edge, p.t_a, p.t_b});
      out.loops.push_back(std::move(c));
    }
  }

  void sphere(std::vector<Lifted>& loops, const SphereSurface& s) {
    // The centre of projection has to lie outside the face. First try: opposite to the area vector of the largest loop.
    std::size_t pick = 0;
    double best = -1;
    for (std::size_t i = 0; i < loops.size(); ++i) {
      const double a = area_vector(loops[i]).norm();
      if (a > best) best = a, pick = i;
    }
    const Vec3 a = area_vector(loops[pick]);
    Chart& c = out.chart;
    c.is_stereographic = true;
    c.radius_mm = s.radius_mm;
    c.stereo.origin = s.at.origin;
    const double area = a.norm() > 1e-9 * s.radius_mm * s.radius_mm ? project_sphere(loops, s, a.normalized()) : -1;
    if (area <= 0) {
      // The loop is no cap (or the point was inside): a point a little to the right of a border, as far from all borders as one finds.
      Vec3 center = -a.normalized();
      double far = 0;
      for (const Lifted& l : loops)
        for (std::size_t i = 0; i < l.size(); i += std::max<std::size_t>(1, l.size() / 16)) {
          const Vec3 p = (l[i].p - s.at.origin).normalized(), t = (l[(i + 1) % l.size()].p - l[i].p).normalized();
          const Vec3 right = t.cross(p);
          for (double delta : {0.5, 0.2, 0.08, 0.03, 0.01}) {
            if (delta < far) break;
            const Vec3 q = (p * std::cos(delta) + right * std::sin(delta)).normalized();
            double nearest = 10;
            for (const Lifted& m : loops)
              for (const LiftedPoint& w : m) nearest = std::min(nearest, (q - (w.p - s.at.origin).normalized()).norm());
            if (nearest > 0.8 * delta && nearest > far) far = nearest, center = q;
          }
        }
      if (far > 0)
        project_sphere(loops, s, -center);
      else if (area == -1) {
        out.fault = "no point of the sphere outside the face was found";
        return;
      }
    }
    push(loops);
  }

  /// Stereographic image of the loops with z away from the centre of projection; the signed area they enclose comes back.
  double project_sphere(std::vector<Lifted>& loops, const SphereSurface& s, const Vec3& z) {
    Chart& c = out.chart;
    const Eigen::Quaterniond q = quat_from_z(z, s.at.x);
    c.stereo.x = q * Vec3::UnitX(), c.stereo.y = q * Vec3::UnitY(), c.stereo.z = q * Vec3::UnitZ();
    const auto to_q = [&](const Vec3& p) {
      const Vec3 r = (p - s.at.origin).normalized();
      const double h = std::max(1e-9, 1 + r.dot(c.stereo.z));
      return Vec2(2 * s.radius_mm * r.dot(c.stereo.x) / h, 2 * s.radius_mm * r.dot(c.stereo.y) / h);
    };
    double area = 0;
    for (Lifted& l : loops) {
      for (LiftedPoint& p : l) {
        p.uv = to_q(p.p);
        if (p.has_mid) p.uv_mid = to_q(p.p_mid);
      }
      area += signed_area(l);
    }
    return area;
  }

  void band(std::vector<Lifted> winding, std::vector<Lifted> plain, std::vector<int> turns, double period, double period_other,
            const std::vector<Pole>& poles, bool is_turned) {
    if (is_turned) {
      for (Lifted& l : winding) turn_quarter(l);
      for (Lifted& l : plain) turn_quarter(l);
    }
    if (winding.size() == 2 && turns[0] == turns[1] && std::abs(turns[0]) == 1) {  // one of them is given the wrong way round
      reverse(winding[1], -turns[1] * period);
      turns[1] = -turns[1];
    }
    if (winding.size() == 2 && turns[0] == -turns[1] && std::abs(turns[0]) == 1) {
      Lifted &low = winding[turns[0] == 1 ? 0 : 1], &high = winding[turns[0] == 1 ? 1 : 0];
      const auto mean = [](const Lifted& l) {
        double m = 0;
        for (const LiftedPoint& p : l) m += p.uv.y();
        return m / static_cast<double>(l.size());
      };
      if (period_other > 0) {
        const double gap = mean(high) - mean(low);
        shift(high, {0, -period_other * std::floor(gap / period_other - 1e-9)});
      }
      std::size_t best_i = 0, best_j = 0;
      double best_shift = 0;
      find_cut(low, high, plain, period, best_i, best_j, best_shift);
      const Lifted bottom = unrolled(low, best_i, period);
      const double top_start = high[best_j].uv.x() + best_shift;
      Lifted top = high;
      shift(top, {best_shift + period, 0});
      top = unrolled(top, best_j, -period);  // from top_start + period back to top_start
      Lifted polygon = bottom;
      const Vec2 left_low = bottom.front().uv, left_high(top_start, high[best_j].uv.y());
      const Lifted cut = seam(left_low, left_high, is_turned, seam_steps(left_low, left_high, is_turned));
      for (LiftedPoint p : cut) p.uv.x() += period, polygon.push_back(p);
      polygon.insert(polygon.end(), top.begin(), top.end());
      for (std::size_t i = cut.size(); i-- > 0;) polygon.push_back(cut[i]);
      finish(std::move(polygon), std::move(plain), period, is_turned);
      return;
    }
    if (winding.size() == 1 && std::abs(turns[0]) == 1) {
      const bool to_high = turns[0] == 1;
      const Pole* pole = nullptr;
      for (const Pole& p : poles) {
        if (!is_turned && p.axis == 1 && p.is_high == to_high) pole = &p;
        if (is_turned && p.axis == 0 && p.is_high == !to_high) pole = &p;  // turned: y = -u
      }
      if (!pole)  // the only pole is on the other side: the loop is given the wrong way round
        for (const Pole& p : poles)
          if (p.axis == (is_turned ? 0 : 1)) pole = &p;
      if (!pole) {
        out.fault = "a loop runs once around the surface and there is no pole on its inner side";
        return;
      }
      const double y = is_turned ? -pole->value : pole->value;
      std::size_t start = 0;
      if (!plain.empty()) {  // start where the way to the pole is free
        for (std::size_t k = 0; k < winding[0].size(); ++k) {
          const Vec2 a = winding[0][k].uv;
          if (!is_blocked(a, Vec2(a.x(), y), plain, period)) {
            start = k;
            break;
          }
        }
      }
      Lifted polygon = unrolled(winding[0], start, turns[0] * period);
      const Vec2 from = polygon.front().uv, to(from.x(), y);
      const Lifted cut = seam(from, to, is_turned, seam_steps(from, to, is_turned));
      for (LiftedPoint p : cut) p.uv.x() += turns[0] * period, polygon.push_back(p);
      int apex = -1;
      for (const TopoLoop& l : face.loops)
        if (l.vertex >= 0 && (body.vertices[static_cast<std::size_t>(l.vertex)].p - pole->p).norm() < 1e-4) apex = l.vertex;
      if (apex < 0) apex = new_vertex(pole->p);
      const int steps = std::max<int>(12, static_cast<int>(winding[0].size()));
      for (int k = 0; k <= steps; ++k) {
        LiftedPoint p;
        p.vertex = apex, p.p = pole->p;
        p.uv = {from.x() + turns[0] * period * (1 - double(k) / steps), y};
        polygon.push_back(p);
      }
      for (std::size_t i = cut.size(); i-- > 0;) polygon.push_back(cut[i]);
      finish(std::move(polygon), std::move(plain), period, is_turned);
      return;
    }
    out.fault = std::to_string(winding.size()) + " loops run around the surface; a face can have at most two";
  }

  bool is_blocked(const Vec2& a, const Vec2& b, const std::vector<Lifted>& loops, double period) const {
    for (const Lifted& l : loops)
      for (std::size_t i = 0; i < l.size(); ++i) {
        const Vec2 &c = l[i].uv, &d = l[(i + 1) % l.size()].uv;
        const double k0 = std::floor((std::min(a.x(), b.x()) - std::max(c.x(), d.x())) / period);
        for (double k = k0; k <= k0 + 2; ++k)
          if (segments_cross(a, b, c + Vec2(k * period, 0), d + Vec2(k * period, 0))) return true;
      }
    return false;
  }
  bool cuts_loop(const Vec2& a, const Vec2& b, const Lifted& l, double turn, double period) const {  // touching the ends is allowed
    for (std::size_t i = 0; i < l.size(); ++i) {
      const Vec2 c = l[i].uv;
      Vec2 d = l[(i + 1) % l.size()].uv;
      if (i + 1 == l.size()) d.x() += turn;
      const double k0 = std::floor((std::min(a.x(), b.x()) - std::max(c.x(), d.x())) / period);
      for (double k = k0; k <= k0 + 2; ++k) {
        const Vec2 c2 = c + Vec2(k * period, 0), d2 = d + Vec2(k * period, 0);
        const auto same = [](const Vec2& p, const Vec2& q) { return (p - q).norm() < 1e-9 * (1 + p.norm()); };
        if (same(a, c2) || same(a, d2) || same(b, c2) || same(b, d2)) continue;
        if (segments_cross(a, b, c2, d2)) return true;
      }
    }
    return false;
  }

  void find_cut(const Lifted& low, const Lifted& high, const std::vector<Lifted>& plain, double period, std::size_t& bi, std::size_t& bj,
                double& bs) const {
    struct Candidate {
      double cost;
      std::size_t i, j;
      double shift;
    };
    std::vector<Candidate> list;
    const std::size_t step = std::max<std::size_t>(1, low.size() / 96);
    for (std::size_t i = 0; i < low.size(); i += step) {
      Candidate c{1e300, i, 0, 0};
      for (std::size_t j = 0; j < high.size(); ++j) {
        const double dx = low[i].uv.x() - high[j].uv.x(), k = std::round(dx / period) * period, cost = std::abs(dx - k);
        if (cost < c.cost) c = {cost, i, j, k};
      }
      list.push_back(c);
    }
    std::stable_sort(list.begin(), list.end(), [](const Candidate& a, const Candidate& b) { return a.cost < b.cost; });
    bi = list[0].i, bj = list[0].j, bs = list[0].shift;
    for (const Candidate& c : list) {
      const Vec2 a = low[c.i].uv, b = high[c.j].uv + Vec2(c.shift, 0);
      if (is_blocked(a, b, plain, period) || cuts_loop(a, b, low, period, period) || cuts_loop(a, b, high, -period, period)) continue;
      bi = c.i, bj = c.j, bs = c.shift;
      return;
    }
  }

  void finish(Lifted polygon, std::vector<Lifted> plain, double period, bool is_turned) {
    for (Lifted& l : plain) {
      for (int k = 0; k <= 3; ++k) {
        bool found = false;
        for (int sign : {1, -1}) {
          const Vec2 by(sign * k * period, 0);
          if (contains(polygon, l.front().uv + by)) {
            shift(l, by);
            found = true;
            break;
          }
        }
        if (found) break;
      }
    }
    std::vector<Lifted> all{std::move(polygon)};
    for (Lifted& l : plain) all.push_back(std::move(l));
    out.chart.is_turned = is_turned;
    push(all);
  }

  void run() {
    out.chart.surface = &surface, out.chart.domain = &domain;
    out.chart.is_plane = std::holds_alternative<PlaneSurface>(surface.shape);
    const bool is_reversed = !face.same_sense;
    std::vector<Lifted> loops;
    for (const TopoLoop& l : face.loops) {
      if (l.vertex >= 0) continue;
      std::vector<TopoLoop> used;
      if (std::holds_alternative<SphereSurface>(surface.shape) && l.uses.size() < 1000)
        split_seams(l.uses, used);
      else
        used.push_back(l);
      for (const TopoLoop& u : used) loops.push_back(loop_points(body, u, is_reversed, vertices));
    }
    if (loops.empty()) {
      out.is_whole_surface = true;
      return;
    }
    if (const auto* s = std::get_if<SphereSurface>(&surface.shape)) return sphere(loops, *s);
    if (const auto* pl = std::get_if<PlaneSurface>(&surface.shape)) {
      for (Lifted& l : loops)
        for (LiftedPoint& p : l) {
          const Vec3 r = p.p - pl->at.origin;
          p.uv = {r.dot(pl->at.x), r.dot(pl->at.y)};
          if (p.has_mid) p.uv_mid = {(p.p_mid - pl->at.origin).dot(pl->at.x), (p.p_mid - pl->at.origin).dot(pl->at.y)};
        }
      return push(loops);
    }
    Lifter lifter(surface, domain);
    std::vector<Lifted> plain, around_u, around_v;
    std::vector<int> turns_u, turns_v;
    for (Lifted& l : loops) {
      int wu = 0, wv = 0;
      if (!lifter.lift_loop(l, wu, wv)) {
        out.fault = "a loop lies wholly in a pole of its surface";
        return;
      }
      if (wu == 0 && wv == 0)
        plain.push_back(std::move(l));
      else if (wv == 0)
        around_u.push_back(std::move(l)), turns_u.push_back(wu);
      else if (wu == 0)
        around_v.push_back(std::move(l)), turns_v.push_back(wv);
      else {
        out.fault = "a loop runs around the surface in both directions";
        return;
      }
    }
    const Periods period = lifter.period();
    if (!around_u.empty() && !around_v.empty()) {
      out.fault = "loops run around the surface in both directions";
      return;
    }
    if (!around_u.empty()) return band(std::move(around_u), std::move(plain), turns_u, period.u, period.v, lifter.poles(), false);
    if (!around_v.empty()) return band(std::move(around_v), std::move(plain), turns_v, period.v, period.u, lifter.poles(), true);
    // All loops close in the chart: the largest is the outer one, the others are moved by periods into it.
    std::size_t outer = 0;
    double best = -1;
    for (std::size_t i = 0; i < plain.size(); ++i)
      if (const double a = std::abs(signed_area(plain[i])); a > best) best = a, outer = i;
    for (std::size_t i = 0; i < plain.size(); ++i) {
      if (i == outer) continue;
      const Vec2 at = plain[i].front().uv;
      for (int ring = 0; ring <= 2; ++ring) {
        bool found = false;
        for (int a = -ring; a <= ring && !found; ++a)
          for (int b = -ring; b <= ring && !found; ++b) {
            if (std::max(std::abs(a), std::abs(b)) != ring || (a && period.u == 0) || (b && period.v == 0)) continue;
            const Vec2 by(a * period.u, b * period.v);
            if (contains(plain[outer], at + by)) shift(plain[i], by), found = true;
          }
        if (found) break;
      }
    }
    push(plain);
  }

  /// Cuts a loop at the edges it runs there and back: what remains are its true borders.
  static void split_seams(std::vector<EdgeUse> uses, std::vector<TopoLoop>& out) {
    for (std::size_t i = 0; i < uses.size(); ++i)
      for (std::size_t j = i + 1; j < uses.size(); ++j) {
        if (uses[i].edge != uses[j].edge || uses[i].is_forward == uses[j].is_forward) continue;
        std::vector<EdgeUse> inner(uses.begin() + static_cast<std::ptrdiff_t>(i) + 1, uses.begin() + static_cast<std::ptrdiff_t>(j));
        std::vector<EdgeUse> rest(uses.begin() + static_cast<std::ptrdiff_t>(j) + 1, uses.end());
        rest.insert(rest.end(), uses.begin(), uses.begin() + static_cast<std::ptrdiff_t>(i));
        split_seams(std::move(inner), out);
        split_seams(std::move(rest), out);
        return;
      }
    if (uses.empty()) return;
    TopoLoop l;
    l.uses = std::move(uses);
    out.push_back(std::move(l));
  }
};

}  // namespace

Vec2 Chart::uv(const Vec2& w) const {
  const Vec2 r(w.x() / scale.x(), w.y() / scale.y());
  return is_turned ? Vec2(-r.y(), r.x()) : r;
}

Vec2 Chart::q(const Vec2& uv) const {
  const Vec2 r = is_turned ? Vec2(uv.y(), -uv.x()) : uv;
  return {r.x() * scale.x(), r.y() * scale.y()};
}

Chart::Jet Chart::at(const Vec2& w) const {
  if (is_stereographic) {
    const Vec2 s(w.x() / scale.x(), w.y() / scale.y());
    const double r = radius_mm, h = 4 * r * r, m = s.squaredNorm() + h;
    // Inverse of q = 2 r (x, y) / (1 + z) on the unit sphere.
    const double x = 4 * r * s.x() / m, y = 4 * r * s.y() / m, z = (h - s.squaredNorm()) / m;
    Jet j;
    j.p = stereo.origin + r * (x * stereo.x + y * stereo.y + z * stereo.z);
    const double gx = 2 * s.x() / m, gy = 2 * s.y() / m;  // d(ln m)
    j.d0 = r * ((4 * r / m - x * gx) * stereo.x - y * gx * stereo.y + (-2 * s.x() / m - z * gx) * stereo.z) / scale.x();
    j.d1 = r * (-x * gy * stereo.x + (4 * r / m - y * gy) * stereo.y + (-2 * s.y() / m - z * gy) * stereo.z) / scale.y();
    return j;
  }
  Vec2 p = uv(w);
  if (domain->is_periodic_u) p.x() -= (domain->u1 - domain->u0) * std::floor((p.x() - domain->u0) / (domain->u1 - domain->u0));
  if (domain->is_periodic_v) p.y() -= (domain->v1 - domain->v0) * std::floor((p.y() - domain->v0) / (domain->v1 - domain->v0));
  const SurfaceJet j = evaluate_jet(*surface, p.x(), p.y(), 1);
  if (is_turned) return {j.p, j.dv / scale.x(), -j.du / scale.y()};
  return {j.p, j.du / scale.x(), j.dv / scale.y()};
}

FaceChart flatten_face(const Body& body, int face, const Tolerance& tolerance, std::vector<Vec3>& vertices) {
  const TopoFace& f = body.faces[static_cast<std::size_t>(face)];
  const auto k = static_cast<std::size_t>(f.surface);
  Builder b{body, f, body.surfaces[k], body.domains[k], tolerance, vertices, {}};
  b.run();
  return std::move(b.out);
}

}  // namespace asbuilt::step
