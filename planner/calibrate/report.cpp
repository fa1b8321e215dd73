// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include "planner/base/number.hpp"
#include "planner/calibrate/calibrate.hpp"

namespace asbuilt {

namespace {
std::string n(double v, int digits = 3) { return fixed_number(v, digits); }
}  // namespace

std::string calibration_report(const CalibrationRequest& job, const CalibrationResult& r) {
  const Calibrated& c = r.solved;
  const NetworkSolution& s = c.solution;
  const std::string subject = job.subject == CalibrationRequest::Subject::tool ? "tool" : job.subject == CalibrationRequest::Subject::robot ? "robot" : job.is_sensor_fixed ? "fixed sensor" : "sensor";
  std::size_t used = 0;
  for (const ViewLine& v : c.views) used += v.is_used && !v.is_held_out;
  std::string t = fmt::format("{} {}\n", subject, job.id);
  t += fmt::format("accuracy (views the solve had not seen): {} mm rms", n(c.held_out_rms_mm, 4));
  if (c.unit == "px") t += fmt::format(" ({} px)", n(c.held_out_rms, 3));
  t += fmt::format(", mean {} {}, largest {} {}", n(c.held_out_mean, 4), c.unit, n(c.held_out_max, 4), c.unit);
  if (c.network.sight == Sight::pose) t += fmt::format(", turn {} deg", n(deg_from_rad(c.held_out_rad), 4));
  t += fmt::format("; the model expects {} {}\n", n(c.held_out_expected, 4), c.unit);
  t += fmt::format("fit: {} {} rms over {} views, {} degrees of freedom\n", n(c.fit_rms, 4), c.unit, used, s.dof);
  t += fmt::format("found: sensor sd {} {}, robot sd {} mm and {} deg per axis\n", n(s.sensor_sd, 4), c.unit, n(s.robot_sd_mm, 4), n(deg_from_rad(s.robot_sd_rad), 4));
  t += fmt::format("known to: {} mm (sd, worst direction) at what it looks at, turn {} deg\n", n(c.point_sd_mm, 4), n(deg_from_rad(c.turn_sd_rad), 4));
  for (const WeakDirection& w : c.weak) t += "weakest: " + w.text + "\n";
  t += fmt::format("the robot turned about its {} axes by {}, {}, {} deg (rms between views)\n", job.is_sensor_fixed ? "base's" : "flange's", n(deg_from_rad(c.spread.rms_rad[0]), 1),
                   n(deg_from_rad(c.spread.rms_rad[1]), 1), n(deg_from_rad(c.spread.rms_rad[2]), 1));
  if (r.scale_ratio)
    t += fmt::format("{} by the robot's moves: {} % (sd {})\n", c.network.sight == Sight::pixel ? "board's pitch" : "sensor's lengths", n(100 * *r.scale_ratio, 3), n(100 * *r.scale_sd_ratio, 3));
  if (r.length_ratio) t += fmt::format("sensor's lengths by the target's: {} % (sd {})\n", n(100 * *r.length_ratio, 3), n(100 * *r.length_sd_ratio, 3));
  if (r.radius_mm) t += fmt::format("ball with its radius free: {} mm (sd {}), certified {}\n", n(*r.radius_mm, 4), n(*r.radius_sd_mm, 4), n(job.target.diameter_mm / 2, 4));
  if (r.camera && job.is_camera_free) {
    t += "intrinsics:";
    for (int i = 0; i < 8; ++i) t += fmt::format(" {} {}", name_of(static_cast<SensorConstant>(kFx + i)), n((*r.camera)[static_cast<std::size_t>(i)], i < 4 ? 2 : 5));
    t += "\n";
  }
  if (r.drift)
    t += fmt::format("against {} of {}: {} mm (sd {}) at what it looks at, {} deg (sd {}), by chance with probability {:.2g}\n", r.drift->file, r.drift->created, n(r.drift->shift_mm), n(r.drift->shift_sd_mm),
                     n(deg_from_rad(r.drift->turn_rad), 4), n(deg_from_rad(r.drift->turn_sd_rad), 4), r.drift->probability_ratio);
  for (const ArmLine& l : r.arm) {
    const bool is_angle = l.unit == "rad";
    t += fmt::format("arm: {} {} {} (sd {}){}\n", l.name, n(is_angle ? deg_from_rad(l.value) : l.value, is_angle ? 5 : 4), is_angle ? "deg" : "mm", n(is_angle ? deg_from_rad(l.sd) : l.sd, is_angle ? 5 : 4),
                     l.is_held ? ": the captures say nothing, the belief stands" : "");
  }
  for (const std::string& d : r.arm_held) t += "arm: not told by the captures: " + d + "\n";
  t += "starts (closed forms alone, and where the solve from them ended):\n";
  for (const StartLine& l : c.starts)
    t += fmt::format("  {}: {} mm, {} deg off; ended {} mm from the best\n", l.method, n(l.from_best_mm), n(deg_from_rad(l.from_best_rad), 4), n(l.end_mm, 4));
  t += fmt::format("views ({}; held out: predicted by a solve without it):\n", c.unit);
  for (const ViewLine& v : c.views)
    t += fmt::format("  {}{}: residual {}, held out {} (expected {}), robot {} mm {} deg, leverage {} %\n", v.name, v.is_held_out ? " [held out]" : v.is_used ? "" : " [LEFT OUT]", n(v.residual_rms),
                     n(v.held_out_rms), n(v.expected_rms), n(v.robot_mm), n(deg_from_rad(v.robot_rad), 4), n(100 * v.leverage_ratio, 1));
  for (const SeenLine& l : r.seen)
    if (!l.is_seen) t += fmt::format("not used: {}: {}\n", l.name, l.text);
  if (!c.poses_to_add.empty()) {
    t += "poses that would help most (check reach):\n";
    for (const PoseToAdd& p : c.poses_to_add) {
      const Vec3& x = p.T_base_flange.p_mm;
      const Eigen::Quaterniond& q = p.T_base_flange.q;
      t += fmt::format("  {{xyz: [{}, {}, {}], quat: [{}, {}, {}, {}]}}: then {} mm, {} deg\n", n(x.x(), 1), n(x.y(), 1), n(x.z(), 1), n(q.w(), 5), n(q.x(), 5), n(q.y(), 5), n(q.z(), 5), n(p.point_sd_mm, 4),
                       n(deg_from_rad(p.turn_sd_rad), 4));
    }
  }
  return t;
}

}  // namespace asbuilt
