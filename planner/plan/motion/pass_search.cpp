// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/motion/pass_search.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"

namespace asbuilt {
namespace {

constexpr double kMarginWanted_rad = rad_from_deg(10), kSingularityWanted_ratio = 0.06;
constexpr double kPostureWeight_mm = 0.2, kTravelWeight_mm_per_rad = 0.003, kTurnWeight_mm_per_rad = 0.01;
constexpr std::size_t kBranchesAtMost = 24;

/// How far a point is beyond what the arm can reach with this orientation: along the line to the shoulder.
double beyond_reach_mm(const PassTools& tools, const Pose<frame::Base, frame::Tool>& T) {
  const Vec3 shoulder = tools.robot->axes(JointVector{})[1].second;
  const double whole = (T.p_mm - shoulder).norm();
  double out = 0, in = 1;
  for (int k = 0; k <= 40; ++k) {  // first reachable place on the way in
    in = k / 40.0;
    if (!tools.free_robot->inverse(Pose<frame::Base, frame::Tool>(T.q, T.p_mm + in * (shoulder - T.p_mm)) * tools.T_flange_tool.inverse()).empty()) break;
    out = in;
  }
  for (int k = 0; k < 20; ++k) {
    const double t = 0.5 * (out + in);
    const bool is_in = !tools.free_robot->inverse(Pose<frame::Base, frame::Tool>(T.q, T.p_mm + t * (shoulder - T.p_mm)) * tools.T_flange_tool.inverse()).empty();
    (is_in ? in : out) = t;
  }
  return in * whole;
}

/// Why there is no solution at this pose: out of reach, or only beyond a joint's limit (the smallest such excess).
PathFault no_solution(const PassTask& task, const PassTools& tools, std::size_t station, const Pose<frame::Base, frame::Tool>& T) {
  PathFault f;
  const auto free = tools.free_robot->inverse(T * tools.T_flange_tool.inverse());
  if (free.empty()) {
    const double beyond = beyond_reach_mm(tools, T);
    f.rank = 0;
    f.refusal = {.code = "motion.unreachable",
                 .where = place(task, station),
                 .message = "the arm does not reach this point with the tool's axis as the recipe wants it: it is " + text_mm(beyond) +
                            " mm too far; move the fixture nearer or choose another axis",
                 .measured = beyond, .limit = 0, .unit = "mm", .stage = "motion"};
    return f;
  }
  const auto& joints = tools.robot->spec().joints;
  double least = 1e9;
  int joint = 0;
  for (const JointVector& q : free) {
    double worst = -1e9;
    int at = 0;
    for (int i = 0; i < 6; ++i) {
      const double excess = std::max(joints[i].min_rad - q[i], q[i] - joints[i].max_rad) + tools.joint_margin_rad;
      if (excess > worst) worst = excess, at = i;
    }
    if (worst < least) least = worst, joint = at;
  }
  f.rank = 1;
  f.refusal = {.code = "motion.joint_limit",
               .where = place(task, station),
               .message = "joint " + std::to_string(joint + 1) + " would be " + fixed_number(deg_from_rad(least), 1) + " degrees beyond its limit (margin " +
                          fixed_number(deg_from_rad(tools.joint_margin_rad), 1) + " degrees) here at every turn of the tool; move the part or turn the fixture",
               .measured = deg_from_rad(least), .limit = 0, .unit = "deg", .stage = "motion"};
  return f;
}

Eigen::Matrix<double, 3, Eigen::Dynamic> error_at_tool(const PassTools& tools, const JointVector& q) {
  const Eigen::MatrixXd m = tools.errors->twist(q);
  const Mat3 R = tools.robot->forward(q).rotation();
  return R * (m.topRows<3>() - skew(tools.T_flange_tool.p_mm) * m.bottomRows<3>());
}

}  // namespace

double largest_joint_step(const JointVector& a, const JointVector& b) {
  double d = 0;
  for (int i = 0; i < 6; ++i) d = std::max(d, std::abs(a[i] - b[i]));
  return d;
}

std::string text_mm(double v) { return fixed_number(v, 2); }
std::string text_point(const Vec3& p) {
  return "(" + fixed_number(p.x(), 1) + ", " + fixed_number(p.y(), 1) + ", " + fixed_number(p.z(), 1) + ")";
}
std::string place(const PassTask& task, std::size_t station) {
  return task.where + " at " + fixed_number(task.stations[std::min(station, task.stations.size() - 1)].s_mm, 1) + " mm";
}

Pose<frame::Base, frame::Tool> tool_pose(const PassTask& task, std::size_t station, double turn_rad) {
  const PassStation& s = task.stations[station];
  const Eigen::Quaterniond q = quat_from_z(s.axis, task.x_hint) * Eigen::Quaterniond(Eigen::AngleAxisd(turn_rad, Vec3::UnitZ()));
  return {q.normalized(), s.tip};
}

std::optional<std::vector<JointVector>> follow_path(const PassTask& task, const PassTools& tools, const std::vector<double>& turns,
                                                    const JointVector& q_first, std::size_t stride, PathFault& fault) {
  const Robot& robot = *tools.robot;
  const auto T_tool_flange = tools.T_flange_tool.inverse();
  const int branch = robot.branch(q_first);
  std::vector<JointVector> out;
  JointVector near = q_first;
  const std::size_t n = task.stations.size();
  double turned_mm = 1e9;
  for (std::size_t i = 0; i < n;) {
    const auto T = tool_pose(task, i, turns[i]);
    const auto q = robot.inverse_near(T * T_tool_flange, near);
    const double margin = q ? robot.joint_margin_rad(*q) : -1;
    if (!q || margin < tools.joint_margin_rad) {
      const PathFault why = no_solution(task, tools, i, T);
      fault.rank = why.rank, fault.refusal = why.refusal, fault.station = i;
      return std::nullopt;
    }
    fault.joint_margin_rad = std::min(fault.joint_margin_rad, margin);
    // Singularities are smooth in the path: looked at every 2 mm.
    if (i > 0) turned_mm += (task.stations[i].tip - task.stations[i > stride ? i - stride : 0].tip).norm();
    if (turned_mm > 2 || i + 1 == n) {
      turned_mm = 0;
      const double ratio = robot.singularity_ratio(*q);
      fault.singularity_ratio = std::min(fault.singularity_ratio, ratio);
      if (ratio < kSingularityLimit_ratio) {
        fault.rank = 3, fault.station = i;
        fault.refusal = {.code = "motion.singular",
                         .where = place(task, i),
                         .message = "the arm is singular here at every turn of the tool: its Jacobian's smallest singular value is " +
                                    fixed_number(ratio, 4) + " (at least " + fixed_number(kSingularityLimit_ratio, 2) +
                                    " is wanted); move or turn the part, or tilt the axis",
                         .measured = ratio, .limit = kSingularityLimit_ratio, .unit = "", .stage = "motion"};
        return std::nullopt;
      }
    }
    if (i > 0 && (largest_joint_step(*q, near) > kJumpLimit_rad || robot.branch(*q) != branch)) {
      fault.rank = 2, fault.station = i;
      fault.refusal = {.code = "motion.joint_limit",
                       .where = place(task, i),
                       .message = "the arm would have to change its posture by " + fixed_number(deg_from_rad(largest_joint_step(*q, near)), 1) +
                                  " degrees in the middle of the cut, at every turn of the tool; move the part or split the feature",
                       .measured = deg_from_rad(largest_joint_step(*q, near)), .limit = deg_from_rad(kJumpLimit_rad), .unit = "deg", .stage = "motion"};
      return std::nullopt;
    }
    out.push_back(*q);
    near = *q;
    if (i + 1 == n) break;
    i = std::min(i + stride, n - 1);
  }
  return out;
}

double departure_mm(const PassTask& task, const PassTools& tools, std::size_t station, const JointVector& q) {
  if (!tools.errors || !task.q_reference) return 0;
  // Where the reference posture does not reach this station, the error is taken against the posture itself.
  const auto same_place = tools.robot->inverse_like(tool_pose(task, station, 0) * tools.T_flange_tool.inverse(), *task.q_reference);
  return std::sqrt((error_at_tool(tools, q) - error_at_tool(tools, same_place.value_or(*task.q_reference))).squaredNorm());
}

double posture_cost_mm(const Robot& robot, const JointVector& q) {
  const double limit = std::max(0.0, 1 - robot.joint_margin_rad(q) / kMarginWanted_rad);
  const double singular = std::max(0.0, 1 - robot.singularity_ratio(q) / kSingularityWanted_ratio);
  return kPostureWeight_mm * (limit * limit + singular * singular);
}

void add_candidates(const PassTask& task, const PassTools& tools, double turn_rad, const JointVector& q_before,
                    std::vector<PassCandidate>& candidates, PathFault& fault) {
  const Robot& robot = *tools.robot;
  const auto T = tool_pose(task, 0, turn_rad);
  auto solutions = robot.inverse(T * tools.T_flange_tool.inverse());
  if (solutions.empty()) {
    const PathFault why = no_solution(task, tools, 0, T);
    if (why.rank > fault.rank) fault.rank = why.rank, fault.refusal = why.refusal;
    return;
  }
  std::stable_sort(solutions.begin(), solutions.end(),
                   [&](const JointVector& a, const JointVector& b) { return largest_joint_step(a, q_before) < largest_joint_step(b, q_before); });
  if (solutions.size() > kBranchesAtMost) solutions.resize(kBranchesAtMost);
  // Thin the path to about thirty stations.
  const std::vector<double> turns(task.stations.size(), turn_rad);
  const std::size_t stride = std::max<std::size_t>(1, task.stations.size() / 30);
  for (const JointVector& q : solutions) {
    PathFault f;
    const auto path = follow_path(task, tools, turns, q, stride, f);
    if (!path) {
      if (f.rank > fault.rank) fault.rank = f.rank, fault.refusal = f.refusal;
      continue;
    }
    double posture = 0;
    for (const std::size_t k : {std::size_t{0}, path->size() / 2, path->size() - 1}) posture = std::max(posture, posture_cost_mm(robot, (*path)[k]));
    const std::size_t middle = std::min((path->size() / 2) * stride, task.stations.size() - 1);
    const double error = tools.errors && task.q_reference ? departure_mm(task, tools, middle, (*path)[path->size() / 2]) : kTurnWeight_mm_per_rad * std::abs(turn_rad);
    candidates.push_back({turn_rad, error + posture + kTravelWeight_mm_per_rad * largest_joint_step(q, q_before), q});
  }
}

}  // namespace asbuilt
