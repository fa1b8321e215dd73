// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/path/posture.hpp"

#include <cmath>

#include "planner/robot/error_model.hpp"
#include "planner/robot/robot.hpp"

namespace asbuilt {

namespace {
constexpr double kSameRad = 0.0087;
}

struct PostureError::Impl {
  const Job& job;
  const Location& location;
  const Features& features;
  std::optional<Robot> robot;
  std::map<std::string, RobotErrorModel> models;  // by tool

  const Pose<frame::Base, frame::Tool>* reference(const std::string& feature) const {
    for (const auto* m : {&features.T_base_tool_reference, &location.T_base_tool_reference})
      for (const std::string& key : {feature, std::string()})
        if (const auto at = m->find(key); at != m->end()) return &at->second;
    return nullptr;
  }
};

PostureError::PostureError(const Job& job, const Location& location, const Features& features)
    : impl_(new Impl{job, location, features, {}, {}}) {}
PostureError::~PostureError() = default;
PostureError::PostureError(PostureError&&) noexcept = default;

Mat3 PostureError::covariance(const ToolSpec& tool, const std::string& feature, const Vec3& tip_part, const Vec3& up_part) const {
  Impl& s = *impl_;
  const auto* reference = s.reference(feature);
  if (reference == nullptr) return Mat3::Zero();
  const Vec3 z_reference = reference->direction(Vec3::UnitZ()), z_cut = s.location.T_base_part.direction(-up_part);
  const double angle = std::atan2(z_reference.cross(z_cut).norm(), z_reference.dot(z_cut));
  if (angle < kSameRad) return Mat3::Zero();
  if (!s.robot) {
    auto made = Robot::from(s.job.cell.robot);
    if (!made) return Mat3::Zero();  // motion refuses the robot
    s.robot = *made;
  }
  if (!s.models.count(tool.id)) s.models.emplace(tool.id, RobotErrorModel(*s.robot, tool.T_flange_tool));
  const RobotErrorModel& model = s.models.at(tool.id);
  const Vec3 tip = s.location.T_base_part.point(tip_part);
  const Pose<frame::Tool, frame::Flange> T_tool_flange = tool.T_flange_tool.inverse();
  const Eigen::Quaterniond turn = Eigen::Quaterniond::FromTwoVectors(z_reference, z_cut);
  const auto q_reference = s.robot->inverse_like(Pose<frame::Base, frame::Tool>(reference->q, tip) * T_tool_flange, s.job.cell.robot.home_rad);
  if (!q_reference) return Mat3::Zero();
  const auto q_cut = s.robot->inverse_near(Pose<frame::Base, frame::Tool>((turn * reference->q).normalized(), tip) * T_tool_flange, *q_reference);
  if (!q_cut) return Mat3::Zero();
  // displacement of the tip in base per unit of each of the arm's parameters
  const auto tip_shift = [&](const JointVector& q) -> Eigen::MatrixXd {
    const Eigen::MatrixXd twist = model.twist(q);
    return s.robot->forward(q).rotation() * (twist.topRows(3) - skew(tool.T_flange_tool.p_mm) * twist.bottomRows(3));
  };
  const Eigen::MatrixXd d = tip_shift(*q_cut) - tip_shift(*q_reference);
  const Mat3 R = s.location.T_base_part.rotation();
  return R.transpose() * (d * d.transpose()) * R;
}

}  // namespace asbuilt
