// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/verify/clearance.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt::verifying {

namespace {
constexpr int kDepthMax = 10;     // bisections between two samples
constexpr double kFarMm = 60;     // beyond this a lower bound will do

double line_distance(const Vec3& p, const JointAxis& a) { return (p - a.point).cross(a.direction.normalized()).norm(); }
}  // namespace

namespace {

double point_triangle(const Vec3& p, const std::array<Vec3, 3>& t) {
  // Ericson, Real-Time Collision Detection, 5.1.5
  const Vec3 ab = t[1] - t[0], ac = t[2] - t[0], ap = p - t[0];
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return ap.norm();
  const Vec3 bp = p - t[1];
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return bp.norm();
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return (ap - d1 / (d1 - d3) * ab).norm();
  const Vec3 cp = p - t[2];
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return cp.norm();
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return (ap - d2 / (d2 - d6) * ac).norm();
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return (bp - (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (t[2] - t[1])).norm();
  const double sum = va + vb + vc;
  return (ap - vb / sum * ab - vc / sum * ac).norm();
}

double segment_segment(const Vec3& p, const Vec3& q, const Vec3& r, const Vec3& s) {
  const Vec3 u = q - p, v = s - r, w = p - r;
  const double a = u.dot(u), e = v.dot(v), f = v.dot(w), c = u.dot(w), b = u.dot(v);
  double x = 0, y = 0;
  const double det = a * e - b * b;
  if (a < 1e-18 && e < 1e-18) return w.norm();
  if (a < 1e-18) {
    y = std::clamp(f / e, 0.0, 1.0);
  } else if (e < 1e-18) {
    x = std::clamp(-c / a, 0.0, 1.0);
  } else {
    if (det > 1e-15 * a * e) x = std::clamp((b * f - c * e) / det, 0.0, 1.0);
    y = (b * x + f) / e;
    if (y < 0) y = 0, x = std::clamp(-c / a, 0.0, 1.0);
    if (y > 1) y = 1, x = std::clamp((b - c) / a, 0.0, 1.0);
  }
  return (w + x * u - y * v).norm();
}

bool segment_pierces(const Vec3& p, const Vec3& q, const std::array<Vec3, 3>& t) {
  const Vec3 n = (t[1] - t[0]).cross(t[2] - t[0]);
  const double a = n.dot(p - t[0]), b = n.dot(q - t[0]);
  if ((a > 0 && b > 0) || (a < 0 && b < 0) || a == b) return false;
  const Vec3 x = p + a / (a - b) * (q - p);
  for (int k = 0; k < 3; ++k)
    if (n.dot((t[static_cast<std::size_t>((k + 1) % 3)] - t[static_cast<std::size_t>(k)]).cross(x - t[static_cast<std::size_t>(k)])) < 0) return false;
  return true;
}

double triangle_triangle(const std::array<Vec3, 3>& a, const std::array<Vec3, 3>& b) {
  double d = 1e300;
  for (std::size_t i = 0; i < 3; ++i) {
    if (segment_pierces(a[i], a[(i + 1) % 3], b) || segment_pierces(b[i], b[(i + 1) % 3], a)) return 0;
    d = std::min({d, point_triangle(a[i], b), point_triangle(b[i], a)});
    for (std::size_t j = 0; j < 3; ++j) d = std::min(d, segment_segment(a[i], a[(i + 1) % 3], b[j], b[(j + 1) % 3]));
  }
  return d;
}

double box_distance(const Vec3& p, const Box3& b) {
  return (b.min_mm - p).cwiseMax(p - b.max_mm).cwiseMax(0.0).norm();
}

std::array<Vec3, 3> corners_of(const Mesh& m, int t) {
  const auto& f = m.triangles[static_cast<std::size_t>(t)];
  return {m.vertices[static_cast<std::size_t>(f[0])], m.vertices[static_cast<std::size_t>(f[1])], m.vertices[static_cast<std::size_t>(f[2])]};
}

}  // namespace

Tree::Tree(Mesh mesh) : mesh_(std::move(mesh)) {
  std::vector<int> order(mesh_.triangles.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
  nodes_.reserve(2 * order.size());
  if (!order.empty()) build(order, 0, static_cast<int>(order.size()));
}

int Tree::build(std::vector<int>& order, int begin, int end) {
  const int id = static_cast<int>(nodes_.size());
  nodes_.push_back({});
  Node n;
  for (int i = begin; i < end; ++i)
    for (const Vec3& v : corners_of(mesh_, order[static_cast<std::size_t>(i)])) n.box.extend(v);
  n.center = n.box.center_mm();
  for (int i = begin; i < end; ++i)
    for (const Vec3& v : corners_of(mesh_, order[static_cast<std::size_t>(i)])) n.radius = std::max(n.radius, (v - n.center).norm());
  if (end - begin == 1) {
    n.triangle = order[static_cast<std::size_t>(begin)];
  } else {
    int axis = 0;
    (n.box.max_mm - n.box.min_mm).maxCoeff(&axis);
    const auto middle_of = [&](int t) {
      const auto c = corners_of(mesh_, t);
      return c[0][axis] + c[1][axis] + c[2][axis];
    };
    const int half = (begin + end) / 2;
    std::nth_element(order.begin() + begin, order.begin() + half, order.begin() + end, [&](int a, int b) {
      const double x = middle_of(a), y = middle_of(b);
      return x != y ? x < y : a < b;
    });
    n.left = build(order, begin, half), n.right = build(order, half, end);
  }
  nodes_[static_cast<std::size_t>(id)] = n;
  return id;
}

double Tree::distance(const Eigen::Isometry3d& T, const Tree& other, double cap, WitnessPair* witness) const {
  if (nodes_.empty() || other.nodes_.empty()) return 1e9;
  const auto bound = [&](int a, int b) {
    const Node& n = nodes_[static_cast<std::size_t>(a)];
    return std::max(0.0, box_distance(T * n.center, other.nodes_[static_cast<std::size_t>(b)].box) - n.radius);
  };
  struct Entry {
    double low;
    int a, b;
  };
  std::vector<Entry> stack{{bound(0, 0), 0, 0}};
  if (stack[0].low > cap) return stack[0].low;
  double best = 1e300;
  const auto pair_distance = [&](int mine, int theirs) {
    std::array<Vec3, 3> c = corners_of(mesh_, mine);
    for (Vec3& v : c) v = T * v;
    return triangle_triangle(c, corners_of(other.mesh_, theirs));
  };
  if (witness != nullptr && witness->mine >= 0) best = pair_distance(witness->mine, witness->theirs);
  if (best == 0) return 0;
  while (!stack.empty()) {
    const Entry e = stack.back();
    stack.pop_back();
    if (e.low >= best) continue;
    const Node &x = nodes_[static_cast<std::size_t>(e.a)], &y = other.nodes_[static_cast<std::size_t>(e.b)];
    if (x.triangle >= 0 && y.triangle >= 0) {
      const double d = pair_distance(x.triangle, y.triangle);
      if (d < best) {
        best = d;
        if (witness != nullptr) *witness = {x.triangle, y.triangle};
      }
      if (best == 0) return 0;
      continue;
    }
    const bool split_mine = y.triangle >= 0 || (x.triangle < 0 && x.radius > y.radius);
    Entry one, two;
    if (split_mine)
      one = {bound(x.left, e.b), x.left, e.b}, two = {bound(x.right, e.b), x.right, e.b};
    else
      one = {bound(e.a, y.left), e.a, y.left}, two = {bound(e.a, y.right), e.a, y.right};
    if (one.low < two.low) std::swap(one, two);
    if (one.low < best) stack.push_back(one);
    if (two.low < best) stack.push_back(two);  // the nearer one next
  }
  return best;
}

Body::Body(std::string name, int link, Mesh mesh) : name_(std::move(name)), link_(link), tree_(mesh) {
  if (!tree_.is_empty()) query_ = std::make_shared<MeshQuery>(std::move(mesh));
}

double Body::distance(const Eigen::Isometry3d& T, const Standing& standing, double cap, WitnessPair* witness) const {
  if (tree_.is_empty() || standing.tree.is_empty()) return 1e9;
  const double d = tree_.distance(T, standing.tree, cap, witness);
  if (d == 0) return 0;
  // surfaces apart can still be one inside the other
  const Vec3 mine = T * tree_.mesh().vertices[static_cast<std::size_t>(tree_.mesh().triangles.front()[0])];
  const auto inside_box = [](const Vec3& p, const Tree& t) { return (p - t.center()).norm() <= t.radius(); };
  if (inside_box(mine, standing.tree) && standing.query.contains(mine)) return -d;
  const Mesh& s = standing.tree.mesh();
  const Vec3 theirs = T.inverse() * s.vertices[static_cast<std::size_t>(s.triangles.front()[0])];
  if (inside_box(theirs, tree_) && query_->contains(theirs)) return -d;
  return d;
}

double Body::motion_bound(const ArmState& a, const JointVector& q_a, const JointVector& q_b, int from_link) const {
  if (tree_.is_empty()) return 0;
  const Vec3 c = pose(a) * tree_.center();
  double sum = 0;
  for (int k = from_link; k < std::min(link_, 6); ++k) {
    const double dq = std::abs(q_b[static_cast<std::size_t>(k)] - q_a[static_cast<std::size_t>(k)]);
    if (dq > 0) sum += dq * (line_distance(c, a.axis[static_cast<std::size_t>(k)]) + tree_.radius());
  }
  return 1.05 * sum;  // the distances change a little on the way; steps are a degree or two
}

std::vector<ArmState> states_of(const Arm& arm, const std::vector<Sample>& samples) {
  std::vector<ArmState> out;
  out.reserve(samples.size());
  for (const Sample& s : samples) out.push_back(arm.state(s.q_rad));
  return out;
}

ClearanceResult follow_clearance(const Arm& arm, const std::vector<Sample>& samples, const std::vector<ArmState>& states,
                                 const std::vector<char>& is_cutting, const PairRule& rule) {
  ClearanceResult out;
  const Body& body = *rule.body;
  if (body.is_empty() || rule.standing->tree.is_empty()) return out;
  out.pair = body.name() + " - " + rule.standing->name;
  WitnessPair witness;
  const auto exact = [&](const ArmState& s) {
    const Eigen::Isometry3d T = s.link[static_cast<std::size_t>(rule.standing->link)].inverse() * body.pose(s);
    return body.distance(T, *rule.standing, std::min(out.least_mm, kFarMm), &witness);
  };
  const auto note = [&](double d, std::size_t i) {
    if (d < out.least_mm) out.least_mm = d, out.instruction = samples[i].instruction;
  };
  // certifies the way between two states whose distances are d_a and d_b
  const auto certify = [&](auto&& self, const JointVector& q_a, double d_a, const JointVector& q_b, double d_b, int depth) -> double {
    const ArmState s_a = arm.state(q_a);
    const double bound = 0.5 * (d_a + d_b - body.motion_bound(s_a, q_a, q_b, rule.standing->link));
    if (bound >= rule.least_mm || depth >= kDepthMax || d_a < rule.least_mm || d_b < rule.least_mm) return bound;
    JointVector q;
    for (std::size_t i = 0; i < 6; ++i) q[i] = 0.5 * (q_a[i] + q_b[i]);
    const double d = exact(arm.state(q));
    return std::min(self(self, q_a, d_a, q, d, depth + 1), self(self, q, d, q_b, d_b, depth + 1));
  };
  double known = -1;  // lower bound of the distance at the sample before; -1: none
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (rule.only_rapid && is_cutting[i]) {
      known = -1;
      continue;
    }
    const ArmState& s = states[i];
    double mu = 0;
    if (known >= 0 && i > 0) {
      mu = body.motion_bound(states[i - 1], samples[i - 1].q_rad, samples[i].q_rad, rule.standing->link);
      const double low = known - mu;
      // far enough that neither the least distance so far nor the requirement is in question
      if (low > rule.least_mm + 0.5 && low >= 0.9 * std::min(out.least_mm, kFarMm)) {
        note(low, i);
        known = low;
        continue;
      }
    }
    const double d = exact(s);
    note(d, i);
    if (known >= 0 && i > 0 && d >= rule.least_mm) {
      double before = known;
      if (0.5 * (before + d - mu) < rule.least_mm) before = exact(states[i - 1]);
      const double certain = certify(certify, samples[i - 1].q_rad, before, samples[i].q_rad, d, 0);
      if (certain < rule.least_mm && before >= rule.least_mm) {
        out.is_certain = false;
        if (certain < out.uncertain_mm) out.uncertain_mm = certain;
      }
    }
    known = std::max(0.0, d);
  }
  return out;
}

Mesh cutter_mesh(const Cutter& c, int around) {
  const double r = 0.5 * c.diameter_mm, top = c.length_mm > 0 ? c.length_mm : 4 * c.diameter_mm;
  std::vector<Vec2> profile;  // radius, height above the tip
  if (c.shape == CutterShape::cone) {
    const double flank = (r - 0.5 * c.tip_diameter_mm) / std::tan(0.5 * c.included_angle_rad);
    profile = {{0.5 * c.tip_diameter_mm, 0}, {r, flank}};
    const double shank = c.shank_diameter_mm > 0 ? 0.5 * c.shank_diameter_mm : r;
    if (shank != r) profile.push_back({shank, flank});
    profile.push_back({shank, top});
  } else if (c.shape == CutterShape::ball) {
    for (int i = 1; i <= 8; ++i) {
      const double a = kPi / 2 * i / 8;
      profile.push_back({r * std::sin(a), r * (1 - std::cos(a))});
    }
    profile.push_back({r, top});
  } else {
    profile = {{r, 0}, {r, top}};
  }
  Mesh m;
  m.vertices.push_back(Vec3::Zero());
  for (const Vec2& p : profile)
    for (int k = 0; k < around; ++k) {
      const double a = 2 * kPi * k / around;
      m.vertices.push_back({p.x() * std::cos(a), p.x() * std::sin(a), -p.y()});
    }
  m.vertices.push_back(Vec3(0, 0, -top));
  const int rings = static_cast<int>(profile.size()), last = static_cast<int>(m.vertices.size()) - 1;
  const auto at = [&](int ring, int k) { return 1 + ring * around + k % around; };
  for (int k = 0; k < around; ++k) {
    m.triangles.push_back({0, at(0, k), at(0, k + 1)});
    for (int i = 0; i + 1 < rings; ++i) {
      m.triangles.push_back({at(i, k), at(i + 1, k), at(i + 1, k + 1)});
      m.triangles.push_back({at(i, k), at(i + 1, k + 1), at(i, k + 1)});
    }
    m.triangles.push_back({last, at(rings - 1, k + 1), at(rings - 1, k)});
  }
  return m;
}

}  // namespace asbuilt::verifying
