// SPDX-License-Identifier: GPL-3.0-or-later
// The motion certificate: distances at a few postures and bounds on how far bodies move between them.
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "planner/base/result.hpp"
#include "planner/robot/collision.hpp"
#include "planner/robot/collision_detail.hpp"

namespace asbuilt {
namespace {

constexpr double kStepFloor_mm = 0.02;  // a block in which nothing moves more than this is as good as its end
constexpr double kWorthKnowing_mm = 30;  // clearances beyond this are not sharpened

/// How far a body moves over a block: by each joint (1..6 at 0..5), and as a whole when it hangs on the flange of a linear block.
struct Travel {
  std::array<double, 6> by_joint_mm{};
  double whole_mm = 1e300;
};

struct Block {
  JointVector a{}, b{};
  std::array<double, 6> swing_rad{};  // how far each joint travels
  JointVector middle{};
};

/// The flange part of the way when its point `straight` moves straight.
Pose<frame::Base, frame::Flange> between(const Pose<frame::Base, frame::Flange>& a, const Pose<frame::Base, frame::Flange>& b, const Vec3& straight,
                                         double t) {
  const Eigen::Quaterniond q = a.q.slerp(t, b.q).normalized();
  const Vec3 from = a.point(straight), to = b.point(straight);
  return {q, from + t * (to - from) - q * straight};
}

}  // namespace

class MotionCertifier {
 public:
  MotionCertifier(const CollisionScene::Impl& scene, const JointPath& path) : scene_(scene), robot_(scene.robot), path_(path) {
    const std::size_t n = path.q_rad.size();
    for (std::size_t i = 0; i + 1 < n; ++i) blocks_.push_back(block(path.q_rad[i], path.q_rad[i + 1]));
    for (const JointVector& q : path.q_rad) poses_.push_back(mount_poses(robot_, q));
    travels_.resize(scene.bodies.size());
  }

  Certificate run(const std::vector<Watch>& watches) {
    Certificate worst;
    for (std::size_t w = 0; w < watches.size(); ++w) {
      const Certificate c = follow(watches[w], static_cast<int>(w));
      if (!c.is_free) return c;
      if (c.clearance_mm < worst.clearance_mm) worst = c;
    }
    return worst;
  }

 private:
  const BodyShape& body(int i) const { return scene_.bodies.at(static_cast<std::size_t>(i)); }

  Block block(const JointVector& a, const JointVector& b) const {
    Block k{a, b, {}, {}};
    for (int i = 0; i < 6; ++i) k.middle[i] = 0.5 * (a[i] + b[i]), k.swing_rad[i] = std::abs(b[i] - a[i]);
    if (path_.is_linear) {
      // The joints bow away from their chord: a quadratic that misses the chord by e at the middle travels at most 2 e more;
      // twice that is allowed for what is not quadratic.
      const auto q = robot_.inverse_near(between(robot_.forward(a), robot_.forward(b), path_.straight_point_flange, 0.5), k.middle);
      for (int i = 0; i < 6; ++i) {
        const double bow = q ? std::abs((*q)[i] - k.middle[i]) : kPi;
        k.swing_rad[i] += 4 * bow + 1e-9;
      }
      if (q) k.middle = *q;
    }
    return k;
  }

  Travel travel(const BodyShape& b, const Block& k) const {
    Travel t;
    if (b.mount == kMountBase || !b.surface) return t;
    const int last = std::min(b.mount, 6);
    const auto axes = robot_.axes(k.middle);
    const Rigid T = mount_poses(robot_, k.middle)[b.mount];
    std::array<Vec3, 8> corners;
    for (int i = 0; i < 8; ++i) corners[i] = T.R * b.corners[i] + T.p;
    // Radius about axis j at the middle, grown by what the joints after it can still move the body over half the block.
    double after = 0;
    for (int j = last - 1; j >= 0; --j) {
      double radius = 0;
      for (const Vec3& c : corners) radius = std::max(radius, (c - axes[j].second).cross(axes[j].first).norm());
      t.by_joint_mm[j] = k.swing_rad[j] * (radius + after);
      after += t.by_joint_mm[j];
    }
    if (path_.is_linear && b.mount == kMountFlange) {
      const auto A = robot_.forward(k.a), B = robot_.forward(k.b);
      double radius = 0;
      const Vec3& straight = path_.straight_point_flange;
      for (const Vec3& c : b.corners) radius = std::max(radius, (c - straight).norm());
      t.whole_mm = (A.point(straight) - B.point(straight)).norm() + A.q.angularDistance(B.q) * radius + 1e-9;
    }
    return t;
  }

  const std::vector<Travel>& travels(int i) {
    auto& t = travels_[static_cast<std::size_t>(i)];
    if (t.empty())
      for (const Block& k : blocks_) t.push_back(travel(body(i), k));
    return t;
  }

  /// Greatest relative motion of the pair over a block.
  double bound(const Watch& w, const Travel& a, const Travel& b) const {
    const int ma = std::min(body(w.a).mount, 6), mb = std::min(body(w.b).mount, 6);
    const bool is_a_outer = ma >= mb;
    const Travel& outer = is_a_outer ? a : b;
    double mu = 0;
    for (int j = std::min(ma, mb); j < std::max(ma, mb); ++j) mu += outer.by_joint_mm[j];
    if (std::min(ma, mb) == 0) mu = std::min(mu, outer.whole_mm);
    return mu;
  }

  Separation measure(const Watch& w, const std::array<Rigid, 8>& T, double enough_mm) const {
    const BodyShape &a = body(w.a), &b = body(w.b);
    const double low = lower_bound(a, b, T[a.mount].inverse() * T[b.mount]);
    if (low >= enough_mm) return {low, false, Vec3::Zero()};
    return exact_separation(a, b, T[a.mount], T[b.mount]);
  }

  Certificate failed(int index, const Separation& s, std::size_t block_index, double ratio, const JointVector& q) const {
    Certificate c;
    c.is_free = false, c.clearance_mm = s.distance_mm, c.watch = index, c.block = block_index, c.at_ratio = ratio;
    c.q_rad = q, c.p_base = s.p_base;
    return c;
  }

  Certificate follow(const Watch& w, int index) {
    Certificate c;
    c.watch = index;
    const std::size_t n = path_.q_rad.size();
    if (n == 0 || !body(w.a).surface || !body(w.b).surface) return c;
    const auto& ta = travels(w.a);
    const auto& tb = travels(w.b);
    std::vector<double> mu(blocks_.size());
    double rest = 0;
    for (std::size_t k = 0; k < blocks_.size(); ++k) rest += mu[k] = bound(w, ta[k], tb[k]);
    std::size_t i = 0;
    const double far = w.margin_mm + kWorthKnowing_mm;
    Separation here = measure(w, poses_[0], std::min(w.margin_mm + rest, far));
    if (here.distance_mm < w.margin_mm) return failed(index, here, 0, 0, path_.q_rad[0]);
    c.clearance_mm = here.distance_mm, c.p_base = here.p_base, c.q_rad = path_.q_rad[0];
    while (i + 1 < n) {
      // As far as this one distance carries while the certified clearance stays worth showing.
      const double level = std::clamp(0.5 * here.distance_mm, w.margin_mm, std::max(w.margin_mm, kWorthKnowing_mm));
      double used = 0;
      std::size_t k = i;
      while (k + 1 < n && here.distance_mm - used - mu[k] >= level) used += mu[k++];
      if (k > i) {
        c.clearance_mm = std::min(c.clearance_mm, here.distance_mm - used);
        rest -= used;
        i = k;
        if (i + 1 >= n) break;
        here = measure(w, poses_[i], std::min(w.margin_mm + rest, far));
        if (here.distance_mm < w.margin_mm) return failed(index, here, i > 0 ? i - 1 : 0, 1, path_.q_rad[i]);
        continue;
      }
      const Separation next = measure(w, poses_[i + 1], std::min(w.margin_mm + rest, far));
      if (next.distance_mm < w.margin_mm) return failed(index, next, i, 1, path_.q_rad[i + 1]);
      const double low = 0.5 * (here.distance_mm + next.distance_mm - mu[i]);
      if (low < w.margin_mm) {
        Certificate inside = halve(w, index, i, blocks_[i], here, next, 0, 1, 0);
        if (!inside.is_free) return inside;
        c.clearance_mm = std::min(c.clearance_mm, inside.clearance_mm);
      } else if (low < c.clearance_mm) {
        c.clearance_mm = low;
      }
      rest -= mu[i];
      ++i;
      here = next;
    }
    return c;
  }

  Certificate halve(const Watch& w, int index, std::size_t at, const Block& k, const Separation& da, const Separation& db, double ta, double tb,
                    int depth) {
    Certificate c;
    c.watch = index;
    const double mu = bound(w, travel(body(w.a), k), travel(body(w.b), k));
    const double low = 0.5 * (da.distance_mm + db.distance_mm - mu);
    if (low >= w.margin_mm) {
      c.clearance_mm = low;
      return c;
    }
    if (mu < kStepFloor_mm || depth > 24) {
      const Separation& s = da.distance_mm < db.distance_mm ? da : db;
      if (s.distance_mm - kStepFloor_mm >= w.margin_mm) {
        c.clearance_mm = s.distance_mm - kStepFloor_mm;
        return c;
      }
      return failed(index, s, at, ta, k.a);
    }
    const JointVector middle = k.middle;
    const Separation dm = measure(w, mount_poses(robot_, middle), w.margin_mm + mu);
    const double tm = 0.5 * (ta + tb);
    if (dm.distance_mm < w.margin_mm) return failed(index, dm, at, tm, middle);
    const Certificate first = halve(w, index, at, block(k.a, middle), da, dm, ta, tm, depth + 1);
    if (!first.is_free) return first;
    const Certificate second = halve(w, index, at, block(middle, k.b), dm, db, tm, tb, depth + 1);
    if (!second.is_free) return second;
    c.clearance_mm = std::min(first.clearance_mm, second.clearance_mm);
    return c;
  }

  const CollisionScene::Impl& scene_;
  const Robot& robot_;
  const JointPath& path_;
  std::vector<Block> blocks_;
  std::vector<std::array<Rigid, 8>> poses_;
  std::vector<std::vector<Travel>> travels_;
};

Certificate CollisionScene::certify(const std::vector<Watch>& watches, const JointPath& path) const {
  must(!path.q_rad.empty(), "a motion has at least one posture");
  return MotionCertifier(*impl_, path).run(watches);
}

}  // namespace asbuilt
