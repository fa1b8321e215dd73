// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/robot_prior.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "planner/base/random.hpp"
#include "planner/robot/error_model.hpp"

namespace asbuilt {
namespace {

// Sensors and tools are calibrated on the real arm: its mean error over the postures of a calibration sits in all of them alike.
// The postures are not known; taken is a sample of such as one calibrates in.
constexpr int kCalibrationPostures = 60;
constexpr double kCalibrationTiltRad = 0.5, kCalibrationSpreadMm = 100.0;
// What that sample does not know of the shared error, and what is each calibration's own: a shift per axis, of the absolute accuracy, and
// a turn, of the one that it makes over one reach of tool. The shared one is at the tool's tip and about it: there, and not at the
// flange, the arm is brought to something known.
constexpr double kSharedShiftRatio = 0.08, kSharedTurnRatio = 0.3, kSharedLeverMm = 700.0;
constexpr double kCalibrationShiftRatio = 0.04, kCalibrationTurnRatio = 0.7;  // a shift at the sensor's focus and a turn about it
constexpr double kSensorFormRatio = 0.6;      // of its noise: the part of its own bending that looks like a motion
constexpr double kWorkingAngleRad = rad_from_deg(15.0);

Mat6 adjoint_about(const Vec3& center, const Mat3& R_base_child, const Vec3& p_child_base) {
  Mat6 a = Mat6::Zero();
  a.topLeftCorner<3, 3>() = R_base_child;
  a.topRightCorner<3, 3>() = -skew(center - p_child_base) * R_base_child;
  a.bottomRightCorner<3, 3>() = R_base_child;
  return a;
}

Eigen::Matrix<double, 3, 6> point_jacobian(const Vec3& p, const Vec3& center) {
  Eigen::Matrix<double, 3, 6> g;
  g.leftCols<3>() = Mat3::Identity();
  g.rightCols<3>() = -skew(p - center);
  return g;
}

struct Cut {  // one feature's way of holding the tool
  const ToolSpec* tool = nullptr;
  Eigen::Quaterniond q_base_tool = Eigen::Quaterniond::Identity();
  JointVector near_rad{};
  bool is_known = false;
  std::vector<Vec3> points_base;  // along the feature's edges
};

class Builder {
 public:
  Builder(const PriorRequest& request, const Robot& robot) : job_(*request.job), cloud_(*request.cloud), request_(request), robot_(robot) {}

  RobotPrior build() {
    prior_.center_base = request_.T_base_part.point(job_.part.brep.mesh.box().center_mm());
    const ToolSpec* tool = first_tool();
    const RobotErrorModel model(robot_, tool ? tool->T_flange_tool : Pose<frame::Flange, frame::Tool>());
    model_ = &model;
    lay_out();
    fill_calibrated(tool);
    fill_captures();
    fill_covariance();
    for (const FeatureSpec& f : job_.part.features) choose_cut(f);
    fill_cuts();
    return std::move(prior_);
  }

 private:
  const ToolSpec* first_tool() const {
    for (const FeatureSpec& f : job_.part.features)
      if (const Recipe* r = job_.recipe(f.recipe))
        if (const ToolSpec* t = job_.tool(r->tool)) return t;
    return job_.cell.tools.empty() ? nullptr : &job_.cell.tools.front();
  }

  void lay_out() {
    prior_.arm_count = model_->size();
    int at = prior_.arm_count;
    prior_.flange_at = at, at += 6;
    prior_.sensor_at.assign(job_.cell.sensors.size(), -1);
    for (const CloudCapture& c : cloud_.captures)
      if (c.sensor >= 0 && prior_.sensor_at[static_cast<std::size_t>(c.sensor)] < 0) prior_.sensor_at[static_cast<std::size_t>(c.sensor)] = -2;
    for (int& s : prior_.sensor_at)
      if (s == -2) s = at, at += 6;
    for (std::size_t k = 0; k < cloud_.captures.size(); ++k) prior_.capture_at.push_back(at), at += 6;
    prior_.size = at;
  }

  /// The arm's mean twist over postures near the part, tool down and turned and tilted at random: what calibrations have taken up.
  void fill_calibrated(const ToolSpec* tool) {
    calibrated_ = Eigen::MatrixXd::Zero(6, prior_.arm_count);
    const Pose<frame::Tool, frame::Flange> T_tool_flange = tool ? tool->T_flange_tool.inverse() : Pose<frame::Tool, frame::Flange>();
    Random random = Random::stream(13, "postures of a calibration");
    JointVector home{};
    for (std::size_t i = 0; i < 6; ++i) home[i] = job_.cell.robot.home_rad[i];
    int count = 0;
    for (int i = 0; i < 4 * kCalibrationPostures && count < kCalibrationPostures; ++i) {
      const double yaw = random.uniform(-kPi, kPi), pitch = random.uniform(-kCalibrationTiltRad, kCalibrationTiltRad), roll = random.uniform(-kCalibrationTiltRad, kCalibrationTiltRad);
      const Vec3 off(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
      const Pose<frame::Base, frame::Tool> T(quat_from_zyx(yaw, pitch, roll) * quat_from_z(-Vec3::UnitZ(), Vec3::UnitX()), prior_.center_base + kCalibrationSpreadMm * off);
      const auto q = robot_.inverse_like(T * T_tool_flange, home);
      if (!q) continue;
      calibrated_ += model_->twist(*q), ++count;
    }
    if (count > 0) calibrated_ /= count;
  }

  /// Of the arm beyond what calibrations have taken up, as a twist of the flange in its own frame.
  Eigen::MatrixXd arm_twist(const JointVector& q) const { return model_->twist(q) - calibrated_; }

  void fill_captures() {
    for (std::size_t k = 0; k < cloud_.captures.size(); ++k) {
      const CloudCapture& c = cloud_.captures[k];
      Eigen::MatrixXd m = Eigen::MatrixXd::Zero(6, prior_.size);
      const Mat6 flange = adjoint_about(prior_.center_base, c.T_base_flange.rotation(), c.T_base_flange.p_mm);
      std::optional<JointVector> q;
      if (c.q_rad) {
        q = JointVector{};
        for (std::size_t i = 0; i < 6; ++i) (*q)[i] = (*c.q_rad)[i];
      } else {
        JointVector home{};
        for (std::size_t i = 0; i < 6; ++i) home[i] = job_.cell.robot.home_rad[i];
        q = robot_.inverse_like(c.T_base_flange, home);
      }
      q_capture_.push_back(q);
      if (q) {
        m.leftCols(prior_.arm_count) = flange * arm_twist(*q);
        scatter_.push_back(model_->scatter(*q));
      } else {
        prior_.notes.push_back({Note::Level::warning, "locate.capture_out_of_reach",
                                "The nominal robot cannot take the pose that the capture names; its error is treated as one of its own.", c.name});
        Mat6 own = Mat6::Zero();
        const double a = std::max(0.05, job_.cell.robot.accuracy.absolute.mean_mm) / std::sqrt(3.0);
        own.diagonal() << a * a, a * a, a * a, 1e-6 * a * a, 1e-6 * a * a, 1e-6 * a * a;
        scatter_.push_back(own);
      }
      m.middleCols(prior_.flange_at, 6) = flange;
      m.middleCols(prior_.sensor_at[static_cast<std::size_t>(c.sensor)], 6) =
          adjoint_about(prior_.center_base, c.T_base_sensor.rotation(), c.T_base_sensor.p_mm);
      m.middleCols(prior_.capture_at[k], 6) = flange;
      prior_.capture.push_back(std::move(m));
    }
  }

  void fill_covariance() {
    prior_.covariance = Eigen::MatrixXd::Zero(prior_.size, prior_.size);
    prior_.covariance.topLeftCorner(prior_.arm_count, prior_.arm_count).setIdentity();
    const double accuracy = std::max(0.02, job_.cell.robot.accuracy.absolute.mean_mm);
    const double shift = kSharedShiftRatio * accuracy, turn = kSharedTurnRatio * accuracy / kSharedLeverMm;
    Mat6 about_tip = Mat6::Identity();
    if (const ToolSpec* tool = first_tool()) about_tip.topRightCorner<3, 3>() = skew(tool->T_flange_tool.p_mm);
    Vec6 shared;
    shared << Vec3::Constant(shift), Vec3::Constant(turn);
    prior_.covariance.block<6, 6>(prior_.flange_at, prior_.flange_at) = about_tip * shared.cwiseAbs2().asDiagonal() * about_tip.transpose();
    const auto put = [&](int at, Mat6 block) {  // a block of zeros would have no inverse
      for (int i = 0; i < 3; ++i) block(i, i) += 1e-8, block(i + 3, i + 3) += 1e-14;
      prior_.covariance.block<6, 6>(at, at) = 0.5 * (block + block.transpose());
    };
    for (const CloudCapture& c : cloud_.captures) {
      const SensorSpec& s = job_.cell.sensors[static_cast<std::size_t>(c.sensor)];
      const double form = kSensorFormRatio * s.noise_mm, half = std::max(10.0, 0.5 * s.field_of_view_mm[0]);
      Mat6 block = c.covariance_sensor;
      for (int i = 0; i < 3; ++i) block(i, i) += form * form, block(i + 3, i + 3) += form * form / (half * half);
      Mat6 about_focus = Mat6::Identity();
      about_focus.topRightCorner<3, 3>() = skew(Vec3(0, 0, s.working_distance_mm));
      Vec6 own;
      own << Vec3::Constant(kCalibrationShiftRatio * accuracy), Vec3::Constant(kCalibrationTurnRatio * accuracy / kSharedLeverMm);
      block += about_focus * own.cwiseAbs2().asDiagonal() * about_focus.transpose();
      put(prior_.sensor_at[static_cast<std::size_t>(c.sensor)], block);
    }
    for (std::size_t k = 0; k < cloud_.captures.size(); ++k) put(prior_.capture_at[k], scatter_[k]);
    prior_.sd = prior_.covariance.diagonal().cwiseMax(0).cwiseSqrt();
  }

  /// 3 x size: how the parameters move the tool's tip off p when the controller is told p with this posture.
  std::optional<Eigen::MatrixXd> tip_error(const Cut& cut, const Vec3& p_base) const {
    const Pose<frame::Base, frame::Tool> T_base_tool(cut.q_base_tool, p_base);
    const Pose<frame::Base, frame::Flange> T_base_flange = T_base_tool * cut.tool->T_flange_tool.inverse();
    const auto q = robot_.inverse_like(T_base_flange, cut.near_rad);
    if (!q) return std::nullopt;
    const Eigen::Matrix<double, 3, 6> tip = T_base_flange.rotation() * point_jacobian(cut.tool->T_flange_tool.p_mm, Vec3::Zero());
    Eigen::MatrixXd e = Eigen::MatrixXd::Zero(3, prior_.size);
    e.leftCols(prior_.arm_count) = tip * arm_twist(*q);
    e.middleCols(prior_.flange_at, 6) = tip;
    return e;
  }

  /// The rigid twist nearest to the tip's error over the points (a trace of stiffness keeps lines and single points solvable).
  std::optional<Eigen::MatrixXd> twist_over(const std::vector<std::pair<const Cut*, Vec3>>& at) const {
    Mat6 normal = Mat6::Zero();
    Eigen::MatrixXd right = Eigen::MatrixXd::Zero(6, prior_.size);
    Vec3 mean = Vec3::Zero();
    for (const auto& [cut, p] : at) mean += p / static_cast<double>(at.size());
    int used = 0;
    for (const auto& [cut, p] : at) {
      const auto e = tip_error(*cut, p);
      if (!e) continue;
      const auto g = point_jacobian(p, mean);
      normal += g.transpose() * g, right += g.transpose() * *e;
      ++used;
    }
    if (used == 0) return std::nullopt;
    normal.diagonal().tail<3>().array() += 1e-3 * used * 100.0;
    Eigen::MatrixXd twist = normal.ldlt().solve(right);
    twist.topRows(3) -= skew(prior_.center_base - mean) * twist.bottomRows(3);
    return twist;
  }

  void choose_cut(const FeatureSpec& f) {
    Cut cut;
    const Recipe* recipe = job_.recipe(f.recipe);
    cut.tool = recipe ? job_.tool(recipe->tool) : nullptr;
    for (const int e : f.edges) {
      const auto& p = job_.part.brep.edges[static_cast<std::size_t>(e)].p;
      const std::size_t step = std::max<std::size_t>(1, p.size() / 6);
      for (std::size_t i = 0; i < p.size(); i += step) cut.points_base.push_back(request_.T_base_part.point(p[i]));
    }
    if (cut.points_base.empty()) cut.points_base.push_back(prior_.center_base);
    if (!cut.tool || !recipe) return;
    Vec3 middle = Vec3::Zero();
    for (const Vec3& p : cut.points_base) middle += p / static_cast<double>(cut.points_base.size());
    const Vec3 axis = recipe->axis_base.normalized();
    // Postures to cut in: those of the working captures, and the tool's x along base x. What counts is how far the robot's error there
    // lies from the mean of what it was in all the working captures: views turned by half a turn take each other's error off.
    std::vector<Cut> candidates;
    Eigen::MatrixXd measured;
    const Eigen::Quaterniond q_along_x = quat_from_z(axis, Vec3::UnitX());
    const auto turn_of = [&](const Cut& c) { return c.q_base_tool.angularDistance(q_along_x); };
    for (std::size_t k = 0; k < cloud_.captures.size(); ++k) {
      const CloudCapture& c = cloud_.captures[k];
      if (!c.feature || *c.feature != f.id || !q_capture_[k]) continue;
      const Vec3 tool_z = (c.T_base_flange.q * cut.tool->T_flange_tool.q) * Vec3::UnitZ();
      if (tool_z.dot(axis) < std::cos(kWorkingAngleRad)) continue;
      Cut candidate = cut;
      candidate.q_base_tool = quat_from_z(axis, (c.T_base_flange.q * cut.tool->T_flange_tool.q) * Vec3::UnitX());
      candidate.near_rad = *q_capture_[k];
      const Eigen::MatrixXd here = point_jacobian(middle, prior_.center_base) * prior_.capture[k];
      measured = candidates.empty() ? here : Eigen::MatrixXd(measured + here);
      candidates.push_back(std::move(candidate));
    }
    if (!candidates.empty()) {
      measured /= static_cast<double>(candidates.size());
      Cut along_x = *std::min_element(candidates.begin(), candidates.end(), [&](const Cut& a, const Cut& b) { return turn_of(a) < turn_of(b) - 1e-9; });
      along_x.q_base_tool = q_along_x;
      candidates.push_back(std::move(along_x));
      std::vector<double> variance;
      double least = std::numeric_limits<double>::infinity();
      for (const Cut& c : candidates) {
        const auto tip = tip_error(c, middle);
        variance.push_back(std::numeric_limits<double>::infinity());
        if (!tip) continue;
        const Eigen::MatrixXd relative = measured - *tip;
        variance.back() = (relative * prior_.covariance * relative.transpose()).trace();
        least = std::min(least, variance.back());
      }
      constexpr double kAsGoodRatio = 1.5;  // of the variance: then the posture nearest to the usual one
      double turn = std::numeric_limits<double>::infinity();
      for (std::size_t i = 0; i < candidates.size(); ++i)
        if (std::isfinite(variance[i]) && variance[i] <= kAsGoodRatio * least && turn_of(candidates[i]) < turn - 1e-9)
          turn = turn_of(candidates[i]), cut = candidates[i], cut.is_known = true;
    }
    if (!cut.is_known) {
      cut.q_base_tool = quat_from_z(axis, Vec3::UnitX());
      for (std::size_t i = 0; i < 6; ++i) cut.near_rad[i] = job_.cell.robot.home_rad[i];
      cut.is_known = tip_error(cut, middle).has_value();
      prior_.notes.push_back({Note::Level::warning, "locate.no_working_view",
                              "No capture of the feature was taken in the working orientation; the robot's error between scan and cut stays in.", f.id});
    }
    prior_.T_base_tool_reference[f.id] = Pose<frame::Base, frame::Tool>(cut.q_base_tool, middle);
    cuts_[f.id] = std::move(cut);
  }

  void fill_cuts() {
    std::vector<std::pair<const Cut*, Vec3>> all;
    for (const auto& [id, cut] : cuts_)
      if (cut.is_known)
        for (const Vec3& p : cut.points_base) all.emplace_back(&cut, p);
    const auto part = all.empty() ? std::nullopt : twist_over(all);
    prior_.cut_part = part ? *part : Eigen::MatrixXd::Zero(6, prior_.size);
    if (!part && !job_.part.features.empty())
      prior_.notes.push_back({Note::Level::warning, "locate.no_cut_posture",
                              "The robot reaches no feature in the wanted tool direction; the location is given as the robot measured it.", ""});
    if (!cuts_.empty() && !prior_.T_base_tool_reference.count("")) {
      const auto& first = prior_.T_base_tool_reference.begin()->second;
      prior_.T_base_tool_reference[""] = Pose<frame::Base, frame::Tool>(first.q, prior_.center_base);
    }
    for (std::size_t k = 0; k < cloud_.captures.size(); ++k) {
      const CloudCapture& c = cloud_.captures[k];
      const auto found = c.feature ? cuts_.find(*c.feature) : cuts_.end();
      std::optional<Eigen::MatrixXd> twist;
      if (found != cuts_.end() && found->second.is_known) {
        // Around the part of the feature that this capture looks at: a cross of seven points of 30 mm.
        const Vec3 looked_at = view_point(c, found->second.points_base);
        std::vector<std::pair<const Cut*, Vec3>> at{{&found->second, looked_at}};
        for (int axis = 0; axis < 3; ++axis)
          for (const double side : {-30.0, 30.0}) at.emplace_back(&found->second, looked_at + side * Vec3::Unit(axis));
        twist = twist_over(at);
      }
      prior_.cut.push_back(twist ? *twist : prior_.cut_part);
    }
  }

  Vec3 view_point(const CloudCapture& c, const std::vector<Vec3>& points) const {
    const double distance = job_.cell.sensors[static_cast<std::size_t>(c.sensor)].working_distance_mm;
    const Vec3 aim = c.T_base_sensor.point(Vec3(0, 0, distance));
    Vec3 best = points.front();
    for (const Vec3& p : points)
      if ((p - aim).squaredNorm() < (best - aim).squaredNorm()) best = p;
    return best;
  }

  const Job& job_;
  const MeasuredCloud& cloud_;
  const PriorRequest& request_;
  const Robot& robot_;
  const RobotErrorModel* model_ = nullptr;
  RobotPrior prior_;
  Eigen::MatrixXd calibrated_;
  std::vector<std::optional<JointVector>> q_capture_;
  std::vector<Mat6> scatter_;
  std::map<std::string, Cut> cuts_;
};

}  // namespace

Result<RobotPrior> make_robot_prior(const PriorRequest& request) {
  auto robot = Robot::from(request.job->cell.robot);
  if (!robot) return tl::unexpected<Refusals>(robot.error());
  return Builder(request, *robot).build();
}

Vec3 moved(const Vec6& twist, const Vec3& center, const Vec3& p) {
  return center + twist.head<3>() + quat_exp(twist.tail<3>()) * (p - center);
}

Pose<frame::Base, frame::Base> pose_of_twist(const Vec6& twist, const Vec3& center) {
  const Eigen::Quaterniond q = quat_exp(twist.tail<3>());
  return {q, center + twist.head<3>() - q * center};
}

}  // namespace asbuilt
