// SPDX-License-Identifier: GPL-3.0-or-later
#include "postprocessors/reading_arm.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt::reading {

namespace {
using Six = std::array<double, 6>;
Six degrees(const JointVector& q) {
  Six out{};
  for (std::size_t i = 0; i < 6; ++i) out[i] = q[i] * 57.29577951308232;
  return out;
}
}  // namespace

Pose<frame::Base, frame::Tool> ArmReader::tool_at(const Six& q_deg, const ToolSpec& tool) const {
  JointVector q{};
  for (std::size_t i = 0; i < 6; ++i) q[i] = q_deg[i] / 57.29577951308232;
  const Eigen::Isometry3d T = arm().flange(q) * tool.T_flange_tool.matrix();
  return {rotation_of(T.linear()), Vec3(T.translation())};
}

std::vector<Six> ArmReader::all(const Pose<frame::Base, frame::Tool>& T_base_tool, const ToolSpec& tool) const {
  const Eigen::Isometry3d T_base_flange = T_base_tool.matrix() * tool.T_flange_tool.inverse().matrix();
  const auto& joints = context_.cell.robot.joints;
  std::vector<JointVector> found;
  // Newton's steps from a grid over what decides the posture: first axis, elbow, wrist; each form of the arm is met from several starts
  const double facing = std::atan2(T_base_flange.translation().y(), T_base_flange.translation().x());
  for (const double first : {facing, -facing, facing + kPi, kPi - facing})
    for (const double second : {0.2, 0.5, 0.8})
      for (const double third : {0.15, 0.4, 0.6, 0.85})
        for (const double fourth : {-2.0, 0.0, 2.0})
          for (const double fifth : {-1.0, 1.0}) {
            JointVector q{std::remainder(first, 2 * kPi), joints[1].min_rad + second * (joints[1].max_rad - joints[1].min_rad),
                          joints[2].min_rad + third * (joints[2].max_rad - joints[2].min_rad), fourth, fifth, 0.5};
            const auto hit = arm().follow(T_base_flange, q);
            if (!hit) continue;
            JointVector r = *hit;
            bool is_known = false;
            for (double& x : r) x = std::remainder(x, 2 * kPi);
            for (const JointVector& k : found) {
              double d = 0;
              for (std::size_t i = 0; i < 6; ++i) d = std::max(d, std::abs(std::remainder(k[i] - r[i], 2 * kPi)));
              is_known |= d < 1e-5;
            }
            if (!is_known) found.push_back(r);
          }
  std::vector<Six> out;
  for (const JointVector& k : found) {  // whole turns within the limits
    std::vector<JointVector> turned{k};
    for (std::size_t i = 0; i < 6; ++i) {
      std::vector<JointVector> next;
      for (const JointVector& t : turned)
        for (int n = -2; n <= 2; ++n) {
          JointVector x = t;
          x[i] += 2 * kPi * n;
          if (x[i] >= joints[i].min_rad - 1e-6 && x[i] <= joints[i].max_rad + 1e-6) next.push_back(x);
        }
      turned = std::move(next);
    }
    for (const JointVector& t : turned) out.push_back(degrees(t));
  }
  std::sort(out.begin(), out.end());
  return out;
}

Six ArmReader::one(const Line& line, const Pose<frame::Base, frame::Tool>& T, const ToolSpec& tool, const std::function<bool(const Six&)>& is_wanted) const {
  std::vector<Six> left;
  const auto possible = all(T, tool);
  for (const Six& q : possible)
    if (is_wanted(q)) left.push_back(q);
  if (left.empty())
    fail(line, "read.posture", possible.empty() ? "the arm does not reach this target" : "the arm reaches this target, but not in the posture written here", static_cast<double>(possible.size()), 1, "postures");
  if (left.size() > 1)
    fail(line, "read.ambiguous", "the arm reaches this target in " + std::to_string(left.size()) + " postures and the program does not say in which; use axis values", static_cast<double>(left.size()), 1, "postures");
  return left.front();
}

}  // namespace asbuilt::reading
