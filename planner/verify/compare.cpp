// SPDX-License-Identifier: GPL-3.0-or-later
// What was read back against what was planned. Remarks say nothing to the machine: only what they say together is compared. Frames are compared by
// themselves: a dialect may say the frame later, or write its points in base; the points themselves are compared in base.
#include <algorithm>
#include <cmath>

#include "planner/verify/checks.hpp"

namespace asbuilt {

namespace {

using namespace verifying;

struct Worst {
  double position_mm = 0, angle_rad = 0, joint_steps = 0, speed_mm_s = 0, ratio = 0, rpm = 0, time_s = 0, looser_mm = 0, tighter_mm = 0, trigger_mm = 0, arc_mm = 0,
         coordinate_mm = 0, each_angle_rad = 0;
  int coordinate_at = -1, each_angle_at = -1, position_at = -1, angle_at = -1, joint_at = -1, speed_at = -1, ratio_at = -1, rpm_at = -1, time_at = -1, looser_at = -1, tighter_at = -1, trigger_at = -1, arc_at = -1;
  double events = 0;
  int events_at = -1;
};

void raise(double& worst, int& at, double value, int i) {
  if (value > worst) worst = value, at = i;
}

template <class A, class B>
void compare_pose(Worst& w, const Pose<A, B>& a, const Pose<A, B>& b, int i) {
  raise(w.position_mm, w.position_at, (a.p_mm - b.p_mm).norm(), i);
  raise(w.angle_rad, w.angle_at, quat_log(a.q.conjugate() * b.q).norm(), i);
}
/// The axes about which half a digit of each of three printed angles turns at most: those of Rz(a) Ry(b), of the rotation as printed. What rounding
/// the first angle turns about the third's axis is the third's to take back, so no more than half a digit is left about any of them.
Mat3 printed_axes(const Eigen::Quaterniond& q, PrintedSteps::Angles angles) {
  const Mat3 R = q.toRotationMatrix();
  const bool is_zyz = angles == PrintedSteps::Angles::turns_zyz;
  const double y = is_zyz ? std::atan2(std::hypot(R(0, 2), R(1, 2)), R(2, 2)) : std::atan2(-R(2, 0), std::hypot(R(0, 0), R(1, 0)));
  const double sure = is_zyz ? std::hypot(R(0, 2), R(1, 2)) : std::hypot(R(0, 0), R(1, 0));
  const double z = sure < 1e-9 ? std::atan2(-R(0, 1), R(1, 1)) : is_zyz ? std::atan2(R(1, 2), R(0, 2)) : std::atan2(R(1, 0), R(0, 0));
  return (Eigen::AngleAxisd(z, Vec3::UnitZ()) * Eigen::AngleAxisd(y, Vec3::UnitY())).toRotationMatrix();
}
/// A point: besides, each of its coordinates in the frame that it was printed in, and each of its angles.
void compare_point(Worst& w, const Pose<frame::Base, frame::Tool>& a, const Pose<frame::Base, frame::Tool>& b, const Eigen::Quaterniond& q_printed, const PrintedSteps& steps, int i) {
  compare_pose(w, a, b, i);
  raise(w.coordinate_mm, w.coordinate_at, (q_printed.conjugate() * (a.p_mm - b.p_mm)).cwiseAbs().maxCoeff(), i);
  if (steps.angles == PrintedSteps::Angles::vector) return;
  const Eigen::Quaterniond q_read = q_printed.conjugate() * b.q;
  const Vec3 turn_work = q_read * quat_log(b.q.conjugate() * a.q);
  raise(w.each_angle_rad, w.each_angle_at, (printed_axes(q_read, steps.angles).transpose() * turn_work).cwiseAbs().maxCoeff(), i);
}

/// How far a point is from the arc through three points; the arc may be named by any point on it.
double off_arc_mm(const Vec3& a, const Vec3& via, const Vec3& b, const Vec3& x) {
  const Vec3 u = via - a, v = b - a, n = u.cross(v);
  if (n.norm() < 1e-9) return (x - via).norm();
  const Vec3 c = a + (v.squaredNorm() * n.cross(u) + u.squaredNorm() * v.cross(n)) / (2 * n.squaredNorm());
  const Vec3 d = x - c;
  const double off = std::hypot(d.norm() - (a - c).norm(), d.dot(n.normalized()));
  // on the side of the chord where the arc is
  return d.dot(via - c) > 0 || (x - 0.5 * (a + b)).dot(via - 0.5 * (a + b)) > 0 ? off : 1e3;
}

void compare_blend(Worst& w, bool exact_a, double a, bool exact_b, double b, int i) {
  // a program may stop where the plan allows rounding, never round more than planned
  const double planned = exact_a ? 0 : a, read = exact_b ? 0 : b;
  raise(w.looser_mm, w.looser_at, read - planned, i);
  raise(w.tighter_mm, w.tighter_at, planned - read, i);
}

void compare_one(Worst& w, const Instruction& a, const Instruction& b, int i, const Vec3& p_before, const Eigen::Quaterniond& q_printed, const PrintedSteps& steps) {
  if (const auto* x = std::get_if<SetTool>(&a)) {
    const auto& y = std::get<SetTool>(b);
    compare_pose(w, x->T_flange_tool, y.T_flange_tool, i);
    raise(w.events, w.events_at, std::abs(x->number - y.number), i);
  } else if (const auto* x = std::get_if<MoveJoint>(&a)) {
    const auto& y = std::get<MoveJoint>(b);
    for (std::size_t k = 0; k < 6; ++k)
      raise(w.joint_steps, w.joint_at, std::abs(x->q_rad[k] - y.q_rad[k]) / (steps.joint_rad[k] > 0 ? steps.joint_rad[k] : rad_from_deg(0.001)), i);
    raise(w.ratio, w.ratio_at, std::abs(x->speed_ratio - y.speed_ratio), i);
  } else if (const auto* x = std::get_if<MoveLinear>(&a)) {
    const auto& y = std::get<MoveLinear>(b);
    compare_point(w, x->T_base_tool, y.T_base_tool, q_printed, steps, i);
    raise(w.speed_mm_s, w.speed_at, std::abs(x->speed_mm_s - y.speed_mm_s), i);
    compare_blend(w, x->is_exact, x->blend_mm, y.is_exact, y.blend_mm, i);
  } else if (const auto* x = std::get_if<MoveCircular>(&a)) {
    const auto& y = std::get<MoveCircular>(b);
    compare_point(w, x->T_base_tool, y.T_base_tool, q_printed, steps, i);
    if (steps.is_via_printed) compare_point(w, x->T_base_via, y.T_base_via, q_printed, steps, i);
    else raise(w.arc_mm, w.arc_at, off_arc_mm(p_before, x->T_base_via.p_mm, x->T_base_tool.p_mm, y.T_base_via.p_mm), i);
    raise(w.speed_mm_s, w.speed_at, std::abs(x->speed_mm_s - y.speed_mm_s), i);
    compare_blend(w, x->is_exact, x->blend_mm, y.is_exact, y.blend_mm, i);
  } else if (const auto* x = std::get_if<MoveSpline>(&a)) {
    const auto& y = std::get<MoveSpline>(b);
    compare_point(w, x->T_base_tool, y.T_base_tool, q_printed, steps, i);
    raise(w.speed_mm_s, w.speed_at, std::abs(x->speed_mm_s - y.speed_mm_s), i);
  } else if (const auto* x = std::get_if<OutputOnPath>(&a)) {
    const auto& y = std::get<OutputOnPath>(b);
    raise(w.events, w.events_at, x->output != y.output || x->value != y.value ? 1 : 0, i);
    raise(w.trigger_mm, w.trigger_at, std::abs(x->path_mm - y.path_mm), i);
  } else if (const auto* x = std::get_if<SwitchOn>(&a)) {
    const auto& y = std::get<SwitchOn>(b);
    raise(w.events, w.events_at, x->what != y.what || x->data != y.data ? 1 : 0, i);
  } else if (const auto* x = std::get_if<SwitchOff>(&a)) {
    const auto& y = std::get<SwitchOff>(b);
    raise(w.events, w.events_at, x->what != y.what || x->data != y.data ? 1 : 0, i);
  } else if (const auto* x = std::get_if<SpindleOn>(&a)) {
    raise(w.rpm, w.rpm_at, std::abs(x->rpm - std::get<SpindleOn>(b).rpm), i);
  } else if (const auto* x = std::get_if<SetOutput>(&a)) {
    const auto& y = std::get<SetOutput>(b);
    raise(w.events, w.events_at, x->output != y.output || x->value != y.value ? 1 : 0, i);
  } else if (const auto* x = std::get_if<Wait>(&a)) {
    raise(w.time_s, w.time_at, std::abs(x->time_s - std::get<Wait>(b).time_s), i);
  }
}

std::vector<const Instruction*> spoken(const Program& p) {
  std::vector<const Instruction*> out;
  for (const Instruction& i : p.instructions)
    if (!std::holds_alternative<Comment>(i) && !std::holds_alternative<SetFrame>(i)) out.push_back(&i);
  return out;
}

/// Of every spoken instruction the frame that was set before it: the one its coordinates were printed in.
std::vector<Eigen::Quaterniond> frames_of_points(const Program& p) {
  std::vector<Eigen::Quaterniond> out;
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
  for (const Instruction& i : p.instructions) {
    if (const auto* s = std::get_if<SetFrame>(&i)) q = s->T_base_work.q;
    else if (!std::holds_alternative<Comment>(i)) out.push_back(q);
  }
  return out;
}

/// What header and remarks say together, without blanks: a dialect may cut a remark, and writes another character for one it lacks.
std::string remarks_of(const Program& p) {
  std::string text;
  const auto add = [&](const std::string& s) {
    for (char x : s) {
      if (x == '{' || x == '(') x = '[';
      if (x == '}' || x == ')') x = ']';
      if (x == '|' || x == '\\') x = '/';
      if (x == '^') x = '*';
      if (x == '`') x = '\'';
      if (x != ' ') text += x;
    }
  };
  for (const std::string& h : p.header) add(h);
  for (const Instruction& i : p.instructions)
    if (const auto* c = std::get_if<Comment>(&i)) add(c->text);
  return text;
}

std::string upper_of(std::string text) {  // some controllers know capitals only
  for (char& c : text) c = static_cast<char>(c >= 'a' && c <= 'z' ? c - 'a' + 'A' : c);
  return text;
}

/// Every frame read back is one of the planned ones, turned by right angles at most, or base.
void compare_frames(Worst& w, const Program& planned, const Program& read_back) {
  for (std::size_t i = 0; i < read_back.instructions.size(); ++i) {
    const auto* y = std::get_if<SetFrame>(&read_back.instructions[i]);
    if (y == nullptr || (y->T_base_work.p_mm.norm() == 0 && y->T_base_work.q.vec().norm() == 0)) continue;
    Worst best;
    best.position_mm = 1e9, best.angle_rad = kPi;
    for (const Instruction& p : planned.instructions)
      if (const auto* x = std::get_if<SetFrame>(&p)) {
        Worst one;
        raise(one.position_mm, one.position_at, (x->T_base_work.p_mm - y->T_base_work.p_mm).norm(), static_cast<int>(i));
        raise(one.angle_rad, one.angle_at, turn_but_right_angles_rad(x->T_base_work.q, y->T_base_work.q), static_cast<int>(i));
        if (one.position_mm + one.angle_rad < best.position_mm + best.angle_rad) best = one;
      }
    raise(w.position_mm, w.position_at, best.position_mm, static_cast<int>(i));
    raise(w.angle_rad, w.angle_at, best.angle_rad, static_cast<int>(i));
  }
}

}  // namespace

double verifying::turn_but_right_angles_rad(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  const Mat3 R = (a.conjugate() * b).toRotationMatrix();
  const Mat3 nearest = R.array().round();
  if (std::abs(nearest.determinant() - 1) > 1e-9 || nearest.cwiseAbs().sum() != 3) return quat_log(a.conjugate() * b).norm();
  return quat_log(Eigen::Quaterniond(Mat3(nearest.transpose() * R)).normalized()).norm();
}

Verdict compare_programs(const Program& planned, const Program& read_back, const PrintedSteps& steps) {
  Verdict v;
  const auto a = spoken(planned), b = spoken(read_back);
  add_check(v, "compare.count", static_cast<double>(b.size()), static_cast<double>(a.size()), "count", a.size() == b.size(), "");
  const std::size_t n = std::min(a.size(), b.size());
  std::size_t first = n;
  for (std::size_t i = 0; i < n; ++i)
    if (a[i]->index() != b[i]->index()) {
      first = i;
      break;
    }
  const bool is_same_order = first == n && a.size() == b.size();
  add_check(v, "compare.order", is_same_order ? 0 : 1, 0, "count", is_same_order, is_same_order ? "" : "instruction " + std::to_string(first + 1));
  Worst w;
  const auto printed = frames_of_points(read_back);
  Vec3 p_before = Vec3::Zero();
  for (std::size_t i = 0; i < first; ++i) {
    compare_one(w, *a[i], *b[i], static_cast<int>(i), p_before, printed[i], steps);
    if (const auto* m = std::get_if<MoveLinear>(a[i])) p_before = m->T_base_tool.p_mm;
    if (const auto* m = std::get_if<MoveCircular>(a[i])) p_before = m->T_base_tool.p_mm;
    if (const auto* m = std::get_if<MoveSpline>(a[i])) p_before = m->T_base_tool.p_mm;
  }
  compare_frames(w, planned, read_back);
  const auto place = [](int i) { return i < 0 ? std::string() : "instruction " + std::to_string(i + 1); };
  // half a printed step per coordinate: the length of the offset is at most root 3 / 2 of a step
  const double position = 0.8661 * steps.position_mm + 1e-6, angle = 0.8661 * steps.angle_rad + 1e-9;
  const double each = 0.5001 * steps.angle_rad + 1e-9;
  add_check(v, "compare.angle", deg_from_rad(w.each_angle_rad), deg_from_rad(each), "deg", w.each_angle_rad <= each, place(w.each_angle_at));
  add_check(v, "compare.position", w.position_mm, position, "mm", w.position_mm <= position, place(w.position_at));
  const double coordinate = 0.5 * steps.position_mm + 1e-6;
  add_check(v, "compare.coordinate", w.coordinate_mm, coordinate, "mm", w.coordinate_mm <= coordinate, place(w.coordinate_at));
  // the circle through three rounded points is off by more than they are; a dialect with a centre may name another point of it
  add_check(v, "compare.arc", w.arc_mm, 5 * position, "mm", w.arc_mm <= 5 * position, place(w.arc_at));
  add_check(v, "compare.orientation", deg_from_rad(w.angle_rad), deg_from_rad(angle), "deg", w.angle_rad <= angle, place(w.angle_at));
  // each joint in its own digit: a pulse is not the same turn everywhere
  add_check(v, "compare.joints", w.joint_steps, 0.5001, "digits", w.joint_steps <= 0.5001, place(w.joint_at));
  const double speed = 0.5 * steps.speed_mm_s + 1e-6;
  add_check(v, "compare.speed", w.speed_mm_s, speed, "mm/s", w.speed_mm_s <= speed, place(w.speed_at));
  const double ratio = 0.5001 * steps.joint_speed_ratio + 1e-9, rpm = 0.5001 * steps.spindle_rpm + 1e-6, time = 0.5001 * steps.time_s + 1e-9;
  add_check(v, "compare.joint_speed", w.ratio, ratio, "ratio", w.ratio <= ratio, place(w.ratio_at));
  add_check(v, "compare.spindle", w.rpm, rpm, "rpm", w.rpm <= rpm, place(w.rpm_at));
  add_check(v, "compare.wait", w.time_s, time, "s", w.time_s <= time, place(w.time_at));
  add_check(v, "compare.events", w.events, 0, "count", w.events == 0, place(w.events_at));
  const double blend = 0.5001 * steps.blend_mm + 1e-6;
  add_check(v, "compare.trigger", w.trigger_mm, coordinate, "mm", w.trigger_mm <= coordinate, place(w.trigger_at));
  add_check(v, "compare.blend", w.looser_mm, blend, "mm", w.looser_mm <= blend, place(w.looser_at));
  if (steps.blend_mm > 0) add_check(v, "compare.blend_kept", w.tighter_mm, blend, "mm", w.tighter_mm <= blend, place(w.tighter_at));
  const bool is_same_name = upper_of(planned.name) == upper_of(read_back.name);
  add_check(v, "compare.name", is_same_name ? 0 : 1, 0, "count", is_same_name, is_same_name ? "" : read_back.name);
  const bool is_same_text = remarks_of(planned) == remarks_of(read_back);
  add_check(v, "compare.remarks", is_same_text ? 0 : 1, 0, "count", is_same_text, "");
  v.path_error_max_mm = w.position_mm;
  v.points_count = b.size();
  return v;
}

}  // namespace asbuilt
