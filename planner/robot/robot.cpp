// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/robot/robot.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "planner/base/random.hpp"
#include "planner/robot/kinematic_chain.hpp"
#include "planner/robot/opw.hpp"

namespace asbuilt {

namespace {

constexpr double kLimitSlack_rad = 1e-9;
constexpr int kNumericStarts = 64;

double difference_mm(const Rigid& a, const Rigid& b, double lever_mm) {
  return (a.p - b.p).norm() + lever_mm * (a.R - b.R).norm();
}

double nearest_turn(double q, double near) { return q + 2 * kPi * std::round((near - q) / (2 * kPi)); }

double largest_difference(const JointVector& a, const JointVector& b) {
  double d = 0;
  for (int i = 0; i < 6; ++i) d = std::max(d, std::abs(a[i] - b[i]));
  return d;
}

Refusal bad(const std::string& where, const std::string& message, double measured, double limit, const std::string& unit) {
  return {.code = "robot.bad_kinematics", .where = where, .message = message, .measured = measured, .limit = limit, .unit = unit, .stage = "input"};
}

}  // namespace

struct Robot::Impl {
  RobotSpec spec;
  KinematicChain chain;
  Rigid flange_at_zero;
  std::optional<OpwArm> opw, near_opw;
  bool is_exact = false;  // the constants reproduce the chain to rounding; otherwise solutions are polished on the chain
  std::vector<JointVector> starts;

  /// Solutions with every joint in (-pi, pi], in a fixed order; `is_singular`: joints 4 and 6 are collinear.
  std::vector<JointVector> principal(const Rigid& T, bool& is_singular) const {
    std::vector<JointVector> out;
    is_singular = false;
    if (opw) {
      const OpwSolutions s = solve_opw(*opw, T);
      is_singular = s.is_wrist_singular;
      for (int i = 0; i < 8; ++i)
        if (s.is_valid[i]) out.push_back(s.q_rad[i]);
      if (is_exact) return out;
    }
    if (!opw || !is_exact) {
      std::vector<JointVector> polished;
      const auto add = [&](const JointVector& start, int iterations) {
        auto q = newton_inverse(chain, T, start, iterations);
        if (!q) return;
        for (double& a : *q) a = nearest_turn(a, 0);
        for (const JointVector& p : polished) {
          double d = 0;
          for (int i = 0; i < 6; ++i) d = std::max(d, std::abs(nearest_turn((*q)[i] - p[i], 0)));
          if (d < 1e-5) return;
        }
        polished.push_back(*q);
      };
      for (const JointVector& q : out) add(q, 12);
      if (near_opw) {
        const OpwSolutions s = solve_opw(*near_opw, T);
        for (int i = 0; i < 8; ++i)
          if (s.is_valid[i]) add(s.q_rad[i], 40);
      }
      if (!opw)
        for (const JointVector& q : starts) add(q, 40);
      out = std::move(polished);
      if (!opw) std::sort(out.begin(), out.end());
    }
    return out;
  }
};

Result<Robot> Robot::from(const RobotSpec& spec) {
  auto impl = std::make_shared<Impl>();
  impl->spec = spec;
  for (int i = 0; i < 6; ++i)
    if (!(spec.joints[i].min_rad < spec.joints[i].max_rad))
      return refuse(bad("robot.joints[" + std::to_string(i) + "]", "the joint's min is not below its max; correct the limits in the cell file",
                        deg_from_rad(spec.joints[i].min_rad), deg_from_rad(spec.joints[i].max_rad), "deg"));
  if (const auto* constants = std::get_if<OpwParameters>(&spec.kinematics)) {
    const double upper = constants->c2_mm, fore = std::hypot(constants->c3_mm, constants->a2_mm);
    if (!(upper > 1e-3) || !(fore > 1e-3))
      return refuse(bad("robot.kinematics.opw", "upper arm (c2) or forearm (c3, a2) has no length; correct the constants in the cell file",
                        std::min(upper, fore), 1e-3, "mm"));
    for (int i = 0; i < 6; ++i)
      if (std::abs(constants->signs[i]) != 1)
        return refuse(bad("robot.kinematics.opw.signs[" + std::to_string(i) + "]", "a sign is 1 or -1", constants->signs[i], 1, ""));
    impl->chain = chain_of(*constants);
    impl->flange_at_zero = flange_of(impl->chain, JointVector{});
    impl->opw = OpwArm{*constants, {}, {}};
    impl->is_exact = true;
  } else {
    const auto& c = std::get<ChainKinematics>(spec.kinematics);
    if (c.joints.size() != 6)
      return refuse(bad("robot.kinematics.urdf: " + c.base_link + " to " + c.tip_link,
                        "the chain does not have six moving joints; name the base and tip link of a six-axis arm",
                        static_cast<double>(c.joints.size()), 6, "joints"));
    std::array<Vec3, 6> axis, point;
    Rigid T;
    for (int i = 0; i < 6; ++i) {
      if (c.joints[i].is_prismatic || c.joints[i].axis.norm() < 1e-9)
        return refuse(bad("robot.kinematics.urdf: joint " + c.joints[i].name, "the joint does not turn; only arms of six turning joints are planned for",
                          0, 1, ""));
      T = T * rigid_of(c.joints[i].T_parent_joint);
      axis[i] = (T.R * c.joints[i].axis).normalized();
      point[i] = T.p;
    }
    impl->flange_at_zero = T * rigid_of(c.T_last_tip);
    impl->chain = KinematicChain::from_axes(axis, point, impl->flange_at_zero);
    impl->opw = opw_of(impl->chain, impl->flange_at_zero, 1.0, 2e-3);
    Random random = Random::stream(1, "robot inverse starts");
    if (impl->opw) {  // how far the closed form is from the chain itself
      const KinematicChain closed = chain_of(impl->opw->constants);
      double worst = 0;
      for (int k = 0; k < 24; ++k) {
        JointVector q;
        for (double& a : q) a = random.uniform(-kPi, kPi);
        const Rigid by_constants = impl->opw->T_base_arm * flange_of(closed, q) * impl->opw->T_wrist_flange;
        worst = std::max(worst, difference_mm(by_constants, flange_of(impl->chain, q), impl->chain.reach_mm));
      }
      impl->is_exact = worst < 1e-8 + 1e-11 * impl->chain.reach_mm;
      if (worst > 5.0) impl->opw.reset();
    }
    if (!impl->opw) {
      // A wrist without a common point: the closed form with the nearest common point starts each branch close by.
      impl->near_opw = opw_of(impl->chain, impl->flange_at_zero, 500.0, 0.3);
      for (int k = 0; k < kNumericStarts; ++k) {
        JointVector q;
        for (int i = 0; i < 6; ++i) q[i] = random.uniform(std::max(spec.joints[i].min_rad, -kPi), std::min(spec.joints[i].max_rad, kPi));
        impl->starts.push_back(q);
      }
    }
  }
  Robot r;
  r.impl_ = std::move(impl);
  return r;
}

const RobotSpec& Robot::spec() const { return impl_->spec; }
bool Robot::is_opw() const { return impl_->opw.has_value(); }
const OpwParameters* Robot::opw() const { return impl_->opw ? &impl_->opw->constants : nullptr; }
double Robot::reach_mm() const { return impl_->chain.reach_mm; }

Pose<frame::Base, frame::Flange> Robot::forward(const JointVector& q_rad) const {
  const Rigid T = flange_of(impl_->chain, q_rad);
  return {Eigen::Quaterniond(T.R).normalized(), T.p};
}

std::array<Pose<frame::Base, frame::Base>, 7> Robot::link_motion(const JointVector& q_rad) const {
  const auto f = joint_frames(impl_->chain, q_rad);
  std::array<Pose<frame::Base, frame::Base>, 7> out;
  for (int i = 0; i < 6; ++i) {
    const Rigid T = f[i] * impl_->chain.zero_inverse[i];
    out[i + 1] = {Eigen::Quaterniond(T.R).normalized(), T.p};
  }
  return out;
}

std::vector<JointVector> Robot::inverse(const Pose<frame::Base, frame::Flange>& T_base_flange) const {
  bool is_singular = false;
  std::vector<JointVector> out;
  const auto& joints = impl_->spec.joints;
  for (const JointVector& q : impl_->principal(rigid_of(T_base_flange), is_singular)) {
    std::array<std::array<double, 8>, 6> choices{};
    std::array<int, 6> counts{};
    bool reachable = true;
    for (int i = 0; i < 6 && reachable; ++i) {
      const double lo = joints[i].min_rad - kLimitSlack_rad, hi = joints[i].max_rad + kLimitSlack_rad;
      const int first = static_cast<int>(std::ceil((lo - q[i]) / (2 * kPi))), last = static_cast<int>(std::floor((hi - q[i]) / (2 * kPi)));
      for (int k = first; k <= last && counts[i] < 8; ++k) choices[i][counts[i]++] = q[i] + 2 * kPi * k;
      reachable = counts[i] > 0;
    }
    if (!reachable) continue;
    std::array<int, 6> at{};
    for (bool more = true; more;) {
      JointVector v;
      for (int i = 0; i < 6; ++i) v[i] = choices[i][at[i]];
      out.push_back(v);
      more = false;
      for (int i = 5; i >= 0 && !more; --i) {
        if (++at[i] < counts[i]) more = true;
        else at[i] = 0;
      }
    }
  }
  return out;
}

namespace {

/// Keeps the cheapest of the solutions at the full turns nearest to `near_rad`. With an exactly singular wrist joint 4 stays.
template <class Principal, class Cost>
std::optional<JointVector> cheapest(const RobotSpec& spec, const OpwParameters* o, const Principal& solutions, bool is_singular, const JointVector& near_rad,
                                    const Cost& cost) {
  std::optional<JointVector> best;
  double least = 1e300;
  for (JointVector q : solutions) {
    if (is_singular && o && std::abs(std::sin(o->signs[4] * q[4] - o->offsets_rad[4])) < 1e-8) {
      // Only the sum (or difference) of joints 4 and 6 is fixed: keep 4 where it is.
      const auto& s = o->signs;
      const bool is_straight = std::cos(s[4] * q[4] - o->offsets_rad[4]) > 0;
      const double shift = near_rad[3] - q[3];
      q[3] = near_rad[3];
      q[5] += (is_straight ? -1.0 : 1.0) * s[3] * s[5] * shift;
    }
    bool is_inside = true;
    for (int i = 0; i < 6; ++i) {
      const double lo = spec.joints[i].min_rad - kLimitSlack_rad, hi = spec.joints[i].max_rad + kLimitSlack_rad;
      double v = nearest_turn(q[i], near_rad[i]);
      while (v > hi) v -= 2 * kPi;
      while (v < lo) v += 2 * kPi;
      q[i] = v;
      is_inside = is_inside && v >= lo && v <= hi;
    }
    if (!is_inside) continue;
    const double c = cost(q);
    if (c < least) best = q, least = c;
  }
  return best;
}

}  // namespace

std::optional<JointVector> Robot::inverse_near(const Pose<frame::Base, frame::Flange>& T_base_flange, const JointVector& near_rad) const {
  const Rigid T = rigid_of(T_base_flange);
  if (!impl_->is_exact) {  // along a path the neighbour is a Newton step away
    if (auto q = newton_inverse(impl_->chain, T, near_rad, 12)) {
      bool is_inside = true;
      for (int i = 0; i < 6; ++i) {
        (*q)[i] = nearest_turn((*q)[i], near_rad[i]);
        const JointSpec& j = impl_->spec.joints[i];
        is_inside = is_inside && (*q)[i] >= j.min_rad - kLimitSlack_rad && (*q)[i] <= j.max_rad + kLimitSlack_rad;
      }
      if (is_inside && largest_difference(*q, near_rad) < 0.2) return q;
    }
  }
  bool is_singular = false;
  const auto solutions = impl_->principal(T, is_singular);
  return cheapest(impl_->spec, opw(), solutions, is_singular, near_rad, [&](const JointVector& q) { return largest_difference(q, near_rad); });
}

std::optional<JointVector> Robot::inverse_like(const Pose<frame::Base, frame::Flange>& T_base_flange, const JointVector& like_rad) const {
  constexpr double kWeights[6] = {1.5, 1.5, 1.2, 0.6, 0.8, 0.4};  // the main axes carry the arm about, the hand turns easily
  bool is_singular = false;
  const auto solutions = impl_->principal(rigid_of(T_base_flange), is_singular);
  const int arm_bits = 3, like = branch(like_rad);
  return cheapest(impl_->spec, opw(), solutions, is_singular, like_rad, [&](const JointVector& q) {
    double c = 0;
    for (int i = 0; i < 6; ++i) c += kWeights[i] * std::abs(q[i] - like_rad[i]);
    return like >= 0 && (branch(q) & arm_bits) != (like & arm_bits) ? c + 100 : c;
  });
}

int Robot::branch(const JointVector& q_rad) const {
  if (!impl_->opw) return -1;
  const OpwParameters& o = impl_->opw->constants;
  std::array<double, 6> t;
  for (int i = 0; i < 6; ++i) t[i] = o.signs[i] * q_rad[i] - o.offsets_rad[i];
  const double forearm = t[1] + t[2];
  const double radial = o.a1_mm + o.c2_mm * std::sin(t[1]) + o.c3_mm * std::sin(forearm) + o.a2_mm * std::cos(forearm);
  const int is_over_shoulder = radial < 0, is_elbow_back = std::sin(t[2] + std::atan2(o.a2_mm, o.c3_mm)) < 0, is_flipped = std::sin(t[4]) < 0;
  return 4 * is_flipped + 2 * is_over_shoulder + is_elbow_back;
}

Mat6 Robot::jacobian(const JointVector& q_rad, const Vec3& p_base) const {
  const auto f = joint_frames(impl_->chain, q_rad);
  Mat6 j;
  for (int i = 0; i < 6; ++i) {
    const Vec3 w = f[i].R.col(2);
    j.col(i).head<3>() = w.cross(p_base - f[i].p);
    j.col(i).tail<3>() = w;
  }
  return j;
}

std::array<std::pair<Vec3, Vec3>, 6> Robot::axes(const JointVector& q_rad) const {
  const auto f = joint_frames(impl_->chain, q_rad);
  std::array<std::pair<Vec3, Vec3>, 6> out;
  for (int i = 0; i < 6; ++i) out[i] = {f[i].R.col(2), f[i].p};
  return out;
}

double Robot::singularity_ratio(const JointVector& q_rad) const {
  Mat6 j = jacobian(q_rad, flange_of(impl_->chain, q_rad).p);
  j.topRows<3>() /= impl_->chain.reach_mm;
  // Root of the smallest eigenvalue of J J^T: several times quicker than the singular values and good to 1e-8 of the largest.
  const double least = Eigen::SelfAdjointEigenSolver<Mat6>(j * j.transpose(), Eigen::EigenvaluesOnly).eigenvalues()[0];
  return std::sqrt(std::max(0.0, least));
}

double Robot::joint_margin_rad(const JointVector& q_rad) const {
  double m = 1e300;
  for (int i = 0; i < 6; ++i)
    m = std::min({m, q_rad[i] - impl_->spec.joints[i].min_rad, impl_->spec.joints[i].max_rad - q_rad[i]});
  return m;
}

}  // namespace asbuilt
