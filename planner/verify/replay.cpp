// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/verify/replay.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"

namespace asbuilt::verifying {

namespace {

using Tcp = Pose<frame::Base, frame::Tool>;

double turn_between(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) { return quat_log(a.conjugate() * b).norm(); }

/// Swing of the tool axis along the great circle, and the roll about it spread evenly.
Eigen::Quaterniond swivel_and_roll(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b, double f) {
  const Vec3 z_a = a * Vec3::UnitZ(), z_b = b * Vec3::UnitZ();
  const Vec3 axis = z_a.cross(z_b);
  const double angle = std::atan2(axis.norm(), z_a.dot(z_b));
  const auto swing = [&](double g) {
    return axis.norm() < 1e-12 ? Eigen::Quaterniond::Identity() : Eigen::Quaterniond(Eigen::AngleAxisd(g * angle, axis.normalized()));
  };
  const Eigen::Quaterniond rest = (swing(1) * a).conjugate() * b;  // about tool z
  const double roll = 2 * std::atan2(rest.z(), rest.w());
  const double wrapped = std::remainder(roll, 2 * kPi);
  return swing(f) * a * Eigen::Quaterniond(Eigen::AngleAxisd(f * wrapped, Vec3::UnitZ()));
}

Vec3 zyx_angles(const Eigen::Quaterniond& q) {
  const Mat3 r = q.toRotationMatrix();
  return {std::atan2(r(1, 0), r(0, 0)), std::atan2(-r(2, 0), std::hypot(r(2, 1), r(2, 2))), std::atan2(r(2, 1), r(2, 2))};
}
Eigen::Quaterniond zyx_linear(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b, double f) {
  const Vec3 from = zyx_angles(a), to = zyx_angles(b);
  Vec3 d = to - from;
  for (int i = 0; i < 3; ++i) d[i] = std::remainder(d[i], 2 * kPi);
  const Vec3 at = from + f * d;
  return quat_from_zyx(at[0], at[1], at[2]);
}

struct Arc {  // through three points
  Vec3 center = Vec3::Zero(), x = Vec3::UnitX(), y = Vec3::UnitY();
  double radius = 0, angle = 0;
  bool is_arc = false;
};
Arc arc_through(const Vec3& a, const Vec3& via, const Vec3& b) {
  Arc arc;
  const Vec3 u = via - a, v = b - a, n = u.cross(v);
  const double nn = n.squaredNorm();
  if (nn < 1e-12) return arc;
  arc.center = a + (u.squaredNorm() * v.cross(n) + v.squaredNorm() * n.cross(u)) / (2 * nn);
  arc.radius = (a - arc.center).norm();
  arc.x = (a - arc.center) / arc.radius;
  arc.y = n.normalized().cross(arc.x);
  const auto angle_of = [&](const Vec3& p) {
    const double t = std::atan2((p - arc.center).dot(arc.y), (p - arc.center).dot(arc.x));
    return t < 0 ? t + 2 * kPi : t;
  };
  arc.angle = angle_of(b);
  arc.is_arc = angle_of(via) < arc.angle;
  return arc;
}

class Player {
 public:
  Player(const CellSpec& cell, const Arm& arm, const Program& program, const ReplaySettings& settings)
      : cell_(cell), arm_(arm), program_(program), settings_(settings) {
    q_ = cell.robot.home_rad;
  }

  Replay run() {
    for (index_ = 0; index_ < static_cast<int>(program_.instructions.size()); ++index_)
      std::visit([this](const auto& i) { play(i); }, program_.instructions[static_cast<std::size_t>(index_)]);
    out_.off_path.insert(out_.off_path.end(), outputs_.begin(), outputs_.end());
    out_.rpm_at_end = rpm_;
    return std::move(out_);
  }

 private:
  const CellSpec& cell_;
  const Arm& arm_;
  const Program& program_;
  const ReplaySettings& settings_;
  Replay out_;
  int index_ = 0;
  JointVector q_{};
  Tcp at_;
  Eigen::Isometry3d T_tool_flange_ = Eigen::Isometry3d::Identity(), T_flange_tool_ = Eigen::Isometry3d::Identity();
  bool has_tool_ = false, has_frame_ = false, is_lost_ = false;
  double rpm_ = 0;
  Vec3 way_in_ = Vec3::Zero();  // direction of the linear move before, for the corner
  double blend_before_ = 0, length_before_ = 0, speed_before_ = 0;
  JointVector rate_before_{};   // joint speeds at the end of the path motion before
  std::vector<int> outputs_;    // that wait for the next motion
  int spline_begin_ = -1;       // first point of the spline that is being gathered

  static void raise(Extreme& e, double v, int i) {
    if (e.instruction < 0 || v > e.value) e.value = v, e.instruction = i;
  }
  static void lower(Extreme& e, double v, int i) {
    if (v < e.value) e.value = v, e.instruction = i;
  }

  void play(const SetTool& t) {
    T_flange_tool_ = t.T_flange_tool.matrix(), T_tool_flange_ = T_flange_tool_.inverse();
    has_tool_ = true;
    if (out_.first_motion >= 0) at_ = Tcp(arm_.flange(q_) * T_flange_tool_);
  }
  void play(const SetFrame&) { has_frame_ = true; }
  void play(const SpindleOn& s) { rpm_ = s.rpm; }
  void play(const SpindleOff&) { rpm_ = 0; }
  void play(const SetOutput&) {}
  void play(const OutputOnPath&) { outputs_.push_back(index_); }
  void play(const SwitchOn& s) {
    if (s.what == Equipment::tool_check) return;
    auto& on = out_.is_on[static_cast<std::size_t>(s.what)];
    if (on) out_.arc_in_transfer.push_back(index_);
    on = true;
  }
  void play(const SwitchOff& s) {
    auto& on = out_.is_on[static_cast<std::size_t>(s.what)];
    if (!on) out_.arc_in_transfer.push_back(index_);
    on = false;
  }
  void play(const Wait& w) { out_.duration_s += std::max(0.0, w.time_s); }
  void play(const Comment&) {}

  void begin_motion(bool is_joint) {
    ++out_.moves_count;
    if (!has_tool_ || (!is_joint && !has_frame_)) out_.before_setup.push_back(index_);  // joints need no frame
    if (out_.first_motion < 0) out_.first_motion = index_, out_.is_first_joint = is_joint;
    out_.last_motion = index_;
  }

  void push(const JointVector& q, const Tcp& T, double speed, bool is_joint, double dt) {
    out_.samples.push_back({index_, q, T, speed, rpm_, is_joint, dt});
    out_.duration_s += dt;
    for (std::size_t i = 0; i < 6; ++i) {
      const JointSpec& j = cell_.robot.joints[i];
      lower(out_.limit_margin_rad, std::min(q[i] - j.min_rad, j.max_rad - q[i]), index_);
    }
  }

  void play(const MoveJoint& m) {
    begin_motion(true);
    outputs_lie_on(0);
    if (out_.is_on[static_cast<std::size_t>(Equipment::arc)]) out_.arc_in_transfer.push_back(index_);
    blend_before_ = 0, way_in_ = Vec3::Zero();
    double longest = 0, duration = 0;
    for (std::size_t i = 0; i < 6; ++i) {
      const double d = std::abs(m.q_rad[i] - q_[i]);
      longest = std::max(longest, d);
      const JointSpec& j = cell_.robot.joints[i];
      if (d > 0 && m.speed_ratio > 0 && j.speed_rad_s > 0) {
        const double v = m.speed_ratio * j.speed_rad_s, a = j.acceleration_rad_s2 > 0 ? j.acceleration_rad_s2 : 1e9;
        duration = std::max(duration, d > v * v / a ? d / v + v / a : 2 * std::sqrt(d / a));
      }
    }
    raise(out_.speed_ratio, m.speed_ratio, index_);
    const int n = std::max(1, static_cast<int>(std::ceil(longest / settings_.joint_step_rad)));
    const JointVector from = q_;
    for (int k = out_.samples.empty() ? 0 : 1; k <= n; ++k) {
      const double f = static_cast<double>(k) / n;
      JointVector q;
      for (std::size_t i = 0; i < 6; ++i) q[i] = from[i] + f * (m.q_rad[i] - from[i]);
      push(q, Tcp(arm_.flange(q) * T_flange_tool_), 0, true, k == 0 ? 0 : duration / n);
    }
    q_ = m.q_rad;
    at_ = out_.samples.back().T_base_tool;
    is_lost_ = false;
  }

  void play(const MoveLinear& m) {
    begin_motion(false);
    const Vec3 d = m.T_base_tool.p_mm - at_.p_mm;
    outputs_lie_on(d.norm());
    corner(d);
    const Tcp from = at_;
    way(from, m.T_base_tool, d.norm(), m.speed_mm_s, [&](double f) { return Vec3(from.p_mm + f * d); });
    way_in_ = d, blend_before_ = m.is_exact ? 0 : m.blend_mm;
  }

  /// Outputs that wait must lie on the motion that comes now.
  void outputs_lie_on(double length_mm) {
    for (const int i : outputs_)
      if (std::abs(std::get<OutputOnPath>(program_.instructions[static_cast<std::size_t>(i)]).path_mm) > length_mm + 0.002) out_.off_path.push_back(i);
    outputs_.clear();
  }

  /// The points of a spline are gathered; with its last one the curve is run. Controllers keep their curves to themselves: here the cubic
  /// through the points with tangents by chord length (Catmull, Rom 1974; centripetal: Yuksel 2011), and how far apart the two are.
  void play(const MoveSpline&) {
    if (spline_begin_ < 0) spline_begin_ = index_;
    const std::size_t next = static_cast<std::size_t>(index_) + 1;
    if (next < program_.instructions.size() && std::holds_alternative<MoveSpline>(program_.instructions[next])) return;
    std::vector<Vec3> p{at_.p_mm};
    for (int i = spline_begin_; i <= index_; ++i) p.push_back(std::get<MoveSpline>(program_.instructions[static_cast<std::size_t>(i)]).T_base_tool.p_mm);
    const auto tangents = [&](double power) {
      std::vector<Vec3> t(p.size());
      const auto gap = [&](std::size_t i) { return std::max(1e-9, std::pow((p[i + 1] - p[i]).norm(), power)); };
      for (std::size_t i = 1; i + 1 < p.size(); ++i) {
        const double a = gap(i - 1), b = gap(i);
        t[i] = ((p[i] - p[i - 1]) / a * b + (p[i + 1] - p[i]) / b * a) / (a + b);
      }
      t.front() = p.size() > 2 ? Vec3(2 * (p[1] - p[0]) / gap(0) - t[1]) : Vec3((p[1] - p[0]) / gap(0));
      t.back() = p.size() > 2 ? Vec3(2 * (p[p.size() - 1] - p[p.size() - 2]) / gap(p.size() - 2) - t[p.size() - 2]) : t.front();
      return t;
    };
    const auto curve = [&](const std::vector<Vec3>& t, double power, std::size_t i, double f) {
      const double h = std::max(1e-9, std::pow((p[i + 1] - p[i]).norm(), power)), f2 = f * f, f3 = f2 * f;
      return Vec3((2 * f3 - 3 * f2 + 1) * p[i] + (f3 - 2 * f2 + f) * h * t[i] + (-2 * f3 + 3 * f2) * p[i + 1] + (f3 - f2) * h * t[i + 1]);
    };
    const auto by_chord = tangents(1), centripetal = tangents(0.5);
    const int last = index_;
    for (int i = spline_begin_; i <= last; ++i) {
      index_ = i;
      const auto& m = std::get<MoveSpline>(program_.instructions[static_cast<std::size_t>(i)]);
      const auto k = static_cast<std::size_t>(i - spline_begin_);
      begin_motion(false);
      if (i == spline_begin_) outputs_lie_on(0);
      for (double f : {0.25, 0.5, 0.75})
        raise(out_.spline_rules_mm, (curve(by_chord, 1, k, f) - curve(centripetal, 0.5, k, f)).norm(), i);
      double length = 0;
      Vec3 before = p[k];
      for (int n = 1; n <= 8; ++n) {
        const Vec3 x = curve(by_chord, 1, k, n / 8.0);
        length += (x - before).norm(), before = x;
      }
      if (i == spline_begin_) corner(by_chord.front());
      way(at_, m.T_base_tool, length, m.speed_mm_s, [&](double f) { return curve(by_chord, 1, k, f); });
      way_in_ = by_chord[k + 1], blend_before_ = 0;
    }
    spline_begin_ = -1;
  }

  void play(const MoveCircular& m) {
    begin_motion(false);
    const Tcp from = at_;
    const Arc arc = arc_through(from.p_mm, m.T_base_via.p_mm, m.T_base_tool.p_mm);
    if (!arc.is_arc || arc.angle > kPi + 1e-6) out_.unreached.push_back(index_);
    outputs_lie_on(arc.radius * arc.angle);
    corner(arc.y);
    way(from, m.T_base_tool, arc.radius * arc.angle, m.speed_mm_s, [&](double f) {
      const double t = f * arc.angle;
      return Vec3(arc.center + arc.radius * (std::cos(t) * arc.x + std::sin(t) * arc.y));
    });
    way_in_ = -std::sin(arc.angle) * arc.x + std::cos(arc.angle) * arc.y, blend_before_ = m.is_exact ? 0 : m.blend_mm;
  }

  /// Within d of a corner that turns by delta, a rounded path stays within (d / 2) sin(delta / 2) of it.
  void corner(const Vec3& way_out) {
    if (blend_before_ <= 0 || way_in_.norm() < 1e-9 || way_out.norm() < 1e-9) return;
    const double delta = std::atan2(way_in_.cross(way_out).norm(), way_in_.dot(way_out));
    if (rpm_ > 0) raise(out_.blend_off_mm, 0.5 * blend_before_ * std::sin(0.5 * delta), index_ - 1);
  }

  template <class Line>
  void way(const Tcp& from, const Tcp& to, double length, double speed, const Line& line) {
    raise(out_.linear_speed_max_mm_s, speed, index_);
    lower(out_.linear_speed_min_mm_s, speed, index_);
    const double turn = turn_between(from.q, to.q);
    raise(out_.orientation_step_rad, turn, index_);
    const bool is_cutting = rpm_ > 0 && speed <= settings_.cutting_speed_max_mm_s;
    const double step = is_cutting ? settings_.cutting_step_mm : settings_.free_step_mm;
    const int n = std::max(1, static_cast<int>(std::ceil(std::max(length / step, turn / rad_from_deg(1.0)))));
    // the time a block takes is not known to be longer than length over speed; pure turns at 60 degrees a second
    const double duration = std::max(speed > 0 ? length / speed : 0.0, length < 1e-6 ? turn / 1.0 : 0.0);
    if (turn > 1e-7)
      for (double f : {0.25, 0.5, 0.75}) {
        const Eigen::Quaterniond s = from.q.slerp(f, to.q);
        for (const Eigen::Quaterniond& other : {swivel_and_roll(from.q, to.q, f), zyx_linear(from.q, to.q, f)})
          raise(out_.orientation_rules_rad, turn_between(s, other), index_);
      }
    at_ = to;
    if (is_lost_) return;
    const std::size_t begin = out_.samples.size();
    JointVector q = q_, rate{};
    for (int k = 1; k <= n; ++k) {
      const double f = static_cast<double>(k) / n;
      const Tcp T(from.q.slerp(f, to.q), line(f));
      const auto next = arm_.follow(T.matrix() * T_tool_flange_, q);
      if (!next) {
        out_.unreached.push_back(index_);
        is_lost_ = true;
        return;
      }
      double jump = 0;
      for (std::size_t i = 0; i < 6; ++i) {
        const double d = std::abs((*next)[i] - q[i]);
        jump = std::max(jump, d);
        rate[i] = duration > 0 ? ((*next)[i] - q[i]) / (duration / n) : 0.0;
        const double limit = cell_.robot.joints[i].speed_rad_s;
        // a controller smooths below its filter's 20 ms
        if (limit > 0 && duration > 0) raise(out_.speed_ratio, d / std::max(duration / n, 0.02) / limit, index_);
      }
      raise(out_.jump_rad, jump, index_);
      if (k == 1) through_corner(rate, length, speed);
      q = *next;
      push(q, T, speed, false, duration / n);
      if (k == n || k % 8 == 0) lower(out_.singularity_ratio, arm_.singularity_ratio(q), index_);
    }
    q_ = q;
    rate_before_ = rate, length_before_ = length, speed_before_ = speed;
    accelerations(begin, duration / n);
  }

  /// A controller passes a rounded corner on a parabola from d before it to d behind it (d: at most half of either motion), and changes the
  /// feed on the way: the joints' speeds change from those before to those behind in the time this takes. At an exact stop the controller
  /// ramps down and up within its own limits, and there is nothing to hold.
  void through_corner(const JointVector& rate, double length, double speed) {
    if (blend_before_ <= 0 || speed <= 0 || speed_before_ <= 0) return;
    const double d = std::min({blend_before_, 0.5 * length_before_, 0.5 * length});
    const double time = std::max(2 * d / (0.5 * (speed + speed_before_)), 0.012);  // an interpolation cycle of the slowest controllers
    for (std::size_t i = 0; i < 6; ++i) {
      const double limit = cell_.robot.joints[i].acceleration_rad_s2;
      if (limit > 0) raise(out_.acceleration_ratio, std::abs(rate[i] - rate_before_[i]) / time / limit, index_);
    }
  }

  /// Five-point second differences of the joints inside one block.
  void accelerations(std::size_t begin, double dt) {
    if (dt <= 0) return;
    const auto stride = static_cast<std::size_t>(std::max(1.0, std::ceil(0.01 / dt)));
    for (std::size_t k = begin + 2 * stride; k + 2 * stride < out_.samples.size(); k += stride)
      for (std::size_t i = 0; i < 6; ++i) {
        const auto q = [&](std::size_t at) { return out_.samples[at].q_rad[i]; };
        const double h = dt * static_cast<double>(stride);
        const double a = (-q(k - 2 * stride) + 16 * q(k - stride) - 30 * q(k) + 16 * q(k + stride) - q(k + 2 * stride)) / (12 * h * h);
        const double limit = cell_.robot.joints[i].acceleration_rad_s2;
        if (limit > 0) raise(out_.acceleration_ratio, std::abs(a) / limit, index_);
      }
  }
};

std::string vec_text(const Vec3& p) {
  return "[" + fixed_number(p.x(), 1) + ", " + fixed_number(p.y(), 1) + ", " + fixed_number(p.z(), 1) + "]";
}

}  // namespace

Replay replay(const CellSpec& cell, const Arm& arm, const Program& program, const ReplaySettings& settings) {
  return Player(cell, arm, program, settings).run();
}

std::string place_of(const Program& program, int instruction) {
  if (instruction < 0 || instruction >= static_cast<int>(program.instructions.size())) return "program " + program.name;
  const Instruction& i = program.instructions[static_cast<std::size_t>(instruction)];
  std::string what = "instruction " + std::to_string(instruction + 1);
  if (const auto* l = std::get_if<MoveLinear>(&i)) what += ": linear move to " + vec_text(l->T_base_tool.p_mm);
  if (const auto* c = std::get_if<MoveCircular>(&i)) what += ": arc to " + vec_text(c->T_base_tool.p_mm);
  if (const auto* c = std::get_if<MoveSpline>(&i)) what += ": point of a spline " + vec_text(c->T_base_tool.p_mm);
  if (std::holds_alternative<MoveJoint>(i)) what += ": joint move";
  return what;
}

}  // namespace asbuilt::verifying
