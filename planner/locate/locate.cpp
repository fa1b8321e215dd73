// SPDX-License-Identifier: GPL-3.0-or-later
// Search, then one adjustment, then the gates. Everything that leaves here is "as the controller has to be told": what the robot
// will do wrong at the cut is taken off.
#include "planner/locate/locate.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/locate/adjust.hpp"
#include "planner/locate/cad_model.hpp"
#include "planner/locate/gates.hpp"
#include "planner/locate/robot_prior.hpp"
#include "planner/locate/scene.hpp"
#include "planner/locate/search.hpp"

namespace asbuilt {
namespace {

constexpr double kSearchMarginMm = 30.0;
constexpr double kSureInlierRatio = 0.8, kSureSeeThroughRatio = 0.02;  // of a part found where the fixture does not let it be

/// Twist in base about center -> twist in the child frame of T_base_child, as a matrix.
template <class B>
Mat6 child_from_base(const Pose<frame::Base, B>& T, const Vec3& center) {
  const Mat3 Rt = T.rotation().transpose();
  Mat6 m = Mat6::Zero();
  m.topLeftCorner<3, 3>() = Rt;
  m.topRightCorner<3, 3>() = -Rt * skew(T.p_mm - center);
  m.bottomRightCorner<3, 3>() = Rt;
  return m;
}

Mat6 symmetric(const Mat6& m) { return 0.5 * (m + m.transpose()); }

Location make_location(const Job& job, const CadModel& cad, const RobotPrior& prior, const Adjusted& adjusted) {
  const AdjustState& s = adjusted.state;
  Location out;
  const Vec6 cut = prior.cut_part * s.robot;
  out.T_base_part = pose_of_twist(-cut, prior.center_base) * s.T_base_part;
  const int n = prior.size;
  Eigen::MatrixXd part(6, 6 + n);
  part.leftCols(6) = Mat6::Identity();
  part.rightCols(n) = -prior.cut_part;
  const Mat6 to_child = child_from_base(out.T_base_part, prior.center_base);
  out.covariance = symmetric(to_child * (part * s.covariance * part.transpose()) * to_child.transpose());
  out.rms_mm = s.rms_mm;
  out.inlier_ratio = s.inlier_ratio;
  const Eigen::MatrixXd robot = s.covariance.bottomRightCorner(n, n);
  for (std::size_t k = 0; k < prior.capture.size(); ++k) {
    const Eigen::MatrixXd relative = prior.capture[k] - prior.cut[k];
    const Vec6 twist = relative * s.robot;
    out.corrections.push_back(pose_of_twist(twist, prior.center_base));
    const Mat6 child = child_from_base(out.corrections.back(), prior.center_base);
    out.correction_covariances.push_back(symmetric(child * (relative * robot * relative.transpose()) * child.transpose()));
  }
  out.T_base_tool_reference = prior.T_base_tool_reference;
  return out;
}

/// Candidates, best first, that look like the scan. Where nothing does in the fixture's play the part is looked for in any turn near it:
/// so the refusal can say how it would fit.
Result<std::vector<Candidate>> search(const LocateRecipe& recipe, const Job& job, const MeasuredCloud& cloud, const Scene& scene, CadModel& cad) {
  std::vector<Vec3> sensors;
  for (const CloudCapture& c : cloud.captures) sensors.push_back(c.T_base_sensor.p_mm);
  if (is_free(job.fixture)) prepare_free_search(cad);
  std::vector<Candidate> found = find_candidates(cad, scene, job.fixture, sensors);
  auto refusal = check_match(recipe, job, found);
  if (!refusal) return found;
  if (!is_free(job.fixture) && !found.empty()) {
    prepare_free_search(cad);
    const std::vector<Candidate> anywhere = find_candidates(cad, scene, opened(job.fixture, cad.size_mm), sensors);
    const bool is_sure = !anywhere.empty() && anywhere.front().inlier_ratio > kSureInlierRatio && anywhere.front().see_through_ratio < kSureSeeThroughRatio;
    if (is_sure && !check_match(recipe, job, anywhere) && !check_ambiguity(recipe, job, cad, anywhere)) {
      const auto outside = check_play(job, anywhere.front().T_base_part);
      if (!outside) return anywhere;
      refusal->message += " It does fit where the fixture does not let it be. " + outside->message;
    }
  }
  return refuse(std::move(*refusal));
}

std::string motion_in_words(const CadModel& cad, const Pose<frame::Base, frame::Part>& best, const Pose<frame::Base, frame::Part>& other) {
  const Pose<frame::Part, frame::Part> motion = best.inverse() * other;
  const Vec3 w = quat_log(motion.q);
  int axis;
  w.cwiseAbs().maxCoeff(&axis);
  const double shift = (motion.point(cad.center_part) - cad.center_part).norm();
  return "rotated " + fixed_number(deg_from_rad(w.norm()), 1) + " deg, mostly about the part's " + std::string(1, "xyz"[axis]) + " axis, shifted " +
         fixed_number(shift, 1) + " mm";
}

}  // namespace

Result<Done<Location>> locate(const LocateRecipe& recipe, const Job& job, const MeasuredCloud& cloud) {
  must(!job.part.brep.mesh.triangles.empty(), "locate: the part has no mesh");
  CadModel cad = make_cad_model(job.part, kSearchMarginMm);
  const Scene scene = make_scene(job, cloud, std::clamp(cad.size_mm / 70, 1.5, 6.0), 2.0);
  const auto searched = search(recipe, job, cloud, scene, cad);
  if (!searched) return tl::unexpected<Refusals>(searched.error());
  const std::vector<Candidate>& found = *searched;
  const std::vector<Hypothesis> hypotheses = [&] {
    std::vector<Hypothesis> out;
    for (const Candidate& c : found)
      out.push_back({c.T_base_part, found.front().log_likelihood - c.log_likelihood, c.inlier_ratio,
                     out.empty() ? std::string("best") : motion_in_words(cad, found.front().T_base_part, c.T_base_part)});
    return out;
  }();
  if (auto refusal = check_ambiguity(recipe, job, cad, found)) return refuse(std::move(*refusal));

  auto prior = make_robot_prior({&job, &cloud, found.front().T_base_part});
  if (!prior) return tl::unexpected<Refusals>(prior.error());
  AdjustRequest request;
  request.cloud = &cloud, request.cad = &cad, request.prior = &*prior;
  request.start = found.front().T_base_part;
  request.part_prior_information = play_information(job.fixture, request.start, prior->center_base);
  const Adjusted adjusted = adjust(request);
  if (auto refusal = check_enough(job, adjusted)) return refuse(std::move(*refusal));

  Done<Location> done;
  done.artefact = make_location(job, cad, *prior, adjusted);
  done.artefact.hypotheses = hypotheses;
  done.artefact.inlier_ratio = found.front().inlier_ratio;
  done.notes = prior->notes;
  describe_observability(cad, request, adjusted, done.artefact);
  // A direction that nothing holds is the reason why the part goes on moving along it: it is named first.
  if (auto refusal = check_observable(job, done.artefact)) return refuse(std::move(*refusal));
  if (auto refusal = check_converged(job, adjusted)) return refuse(std::move(*refusal));
  if (auto refusal = check_adjusted(job, cloud, *prior, request, adjusted, done.artefact)) return refuse(std::move(*refusal));
  done.notes.push_back({Note::Level::note, "locate.quality",
                        "captures agree on shared faces to " + fixed_number(adjusted.state.shared_rms_mm, 4) + " mm (1 sd of one, " +
                            std::to_string(adjusted.state.shared_count) + " pairs); faces deviate by " +
                            fixed_number(adjusted.state.form_sd_mm, 3) + " mm from the drawing (1 sd)",
                        job.item_id});
  return done;
}

}  // namespace asbuilt
