// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/locate.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <iostream>

#include "planner/fuse/fuse.hpp"
#include "planner/robot/error_model.hpp"
#include "tests/unit/locate/synthetic.hpp"

namespace asbuilt {
namespace {

using namespace synthetic;

struct Ring {
  Job job;
  Truth truth;
};

Job ring_job() {
  PartSpec part = make_ring();
  add_feature(part, "lug1", {"top-4", "top-5", "top-6"});
  add_feature(part, "lug4", {"top-16", "top-17", "top-18"});
  return make_job(std::move(part), true);
}

std::vector<View> ring_views(const Pose<frame::Part, frame::Part>& play) {
  const auto at = [&](double deg) { return play.point(Vec3(148 * std::cos(rad_from_deg(deg)), 148 * std::sin(rad_from_deg(deg)), 40)); };
  return usual_views({{"lug1", at(45)}, {"lug4", at(180)}});
}

/// How far corrected points are from where the controller has to be told, with the truth of the arm. By capture: mean over a cross
/// of points around what it looks at.
std::vector<Vec6> correction_errors(const Job& job, const MeasuredCloud& cloud, const Location& l, const Truth& truth) {
  const Robot robot = *Robot::from(job.cell.robot);
  const ToolSpec& tool = job.cell.tools.front();
  const RobotErrorModel model(robot, tool.T_flange_tool);
  JointVector home{};
  for (std::size_t i = 0; i < 6; ++i) home[i] = job.cell.robot.home_rad[i];
  std::vector<Vec6> out;
  for (std::size_t k = 0; k < cloud.captures.size(); ++k) {
    const CloudCapture& c = cloud.captures[k];
    Vec6 e = Vec6::Zero();
    if (c.feature && c.end > c.begin) {
      const auto& reference = l.T_base_tool_reference.at(*c.feature);
      const Vec3 middle = reference.p_mm;
      const Pose<frame::Base, frame::Sensor> eye = truth.T_base_sensor_true[k];
      const auto error_at = [&](const Vec3& p_base) {
        const Vec3 p_true = eye.point(c.T_base_sensor.inverse().point(p_base));
        const Pose<frame::Base, frame::Flange> flange = Pose<frame::Base, frame::Tool>(reference.q, p_true) * tool.T_flange_tool.inverse();
        const auto q = robot.inverse_near(flange, home);
        const Pose<frame::Base, frame::Flange> real = flange.disturbed(model.twist(*q) * truth.arm);
        const Vec3 p_command = p_true - ((real * tool.T_flange_tool).p_mm - p_true);
        return Vec3(l.corrections[k].point(p_base) - p_command);
      };
      e.head<3>() = error_at(middle);
      e.tail<3>() = error_at(middle + Vec3(20, 0, 0)) - e.head<3>();
    }
    out.push_back(e);
  }
  return out;
}

double seconds() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

TEST(Locate, finds_a_ring) {
  Job job = ring_job();
  ScanOptions o;
  o.play = {quat_from_zyx(2.1, 0.01, -0.008), Vec3(2, -3, 1)};
  const Truth truth = scan(job, ring_views(o.play), o);
  double t0 = seconds();
  const auto cloud = fuse({}, job);
  ASSERT_TRUE(cloud) << cloud.error()[0].message;
  std::cout << "fuse " << seconds() - t0 << " s, points " << cloud->artefact.p_base.size() << "\n";
  t0 = seconds();
  const auto found = locate({}, job, cloud->artefact);
  std::cout << "locate " << seconds() - t0 << " s\n";
  ASSERT_TRUE(found) << found.error()[0].code << " " << found.error()[0].message;
  const Location& l = found->artefact;
  const Vec3 c(0, 0, 20);
  std::cout << "off " << (l.T_base_part.point(c) - truth.T_base_part.point(c)).norm() << " mm "
            << deg_from_rad(l.T_base_part.q.angularDistance(truth.T_base_part.q)) << " deg\n";
  const auto errors = correction_errors(job, cloud->artefact, l, truth);
  for (std::size_t k = 0; k < errors.size(); ++k)
    if (cloud->artefact.captures[k].feature)
      std::cout << cloud->artefact.captures[k].name << " " << *cloud->artefact.captures[k].feature << " error " << errors[k].transpose() << "  sd "
                << l.correction_covariances[k].diagonal().head<3>().cwiseSqrt().transpose() << "\n";
  for (const Note& n : found->notes) std::cout << n.text << "\n";
  for (const auto& h : l.hypotheses) std::cout << h.log_likelihood_ratio << " " << h.inlier_ratio << " " << h.note << "\n";
  for (double s : l.singular_values) std::cout << s << " ";
  std::cout << "\n";
}

}  // namespace
}  // namespace asbuilt
