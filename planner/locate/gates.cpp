// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/gates.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>

#include "planner/base/number.hpp"
#include "planner/locate/consistency.hpp"

namespace asbuilt {
namespace {

constexpr double kOtherAngleRad = rad_from_deg(8.0), kOtherShiftMm = 8.0;  // hypotheses nearer than this are one
constexpr double kSeeThroughMax = 0.10;
// What a sound cell shows less often than this is taken for a fault: any of its pairs of captures (Bonferroni), a hand-eye. The hand-eyes' priors are rather too wide
// and their probabilities lie near 1, so their limit is that of one test.
constexpr double kPairsProbabilityMin = 0.02, kHandEyeProbabilityMin = 0.02;
constexpr double kInformationMin = 10.0;        // of the data against the play, else the play decides
constexpr std::size_t kRaysMin = 50, kCellsMin = 60;

std::string number(double x, int decimals) { return fixed_number(x, decimals); }

}  // namespace

std::optional<Refusal> check_match(const LocateRecipe& recipe, const Job& job, const std::vector<Candidate>& found) {
  if (found.empty() || found.front().rays_count < kRaysMin) {
    const double seen = found.empty() ? 0.0 : static_cast<double>(found.front().rays_count);
    return Refusal{.code = "locate.no_match",
                   .where = "item " + job.item_id,
                   .message = "Nothing in the scans lies where part " + job.part.id + " could sit in its fixture (" + number(seen, 0) + " readings, " +
                              number(kRaysMin, 0) + " needed); check that the part is in the fixture and that the fixture's pose is right.",
                   .measured = seen,
                   .limit = static_cast<double>(kRaysMin),
                   .unit = "readings",
                   .stage = "locate"};
  }
  const Candidate& best = found.front();
  if (best.inlier_ratio < recipe.inlier_ratio_min)
    return Refusal{.code = "locate.no_match",
                   .where = "item " + job.item_id,
                   .message = "Part " + job.part.id + " does not fit the scans: at the best pose only " + number(100 * best.inlier_ratio, 1) +
                              " % of the readings that should lie on it do (" + number(100 * recipe.inlier_ratio_min, 1) +
                              " % needed); check that the scans are of this part and that the drawing is the right one.",
                   .measured = best.inlier_ratio,
                   .limit = recipe.inlier_ratio_min,
                   .unit = "ratio",
                   .stage = "locate"};
  if (best.see_through_ratio > kSeeThroughMax)
    return Refusal{.code = "locate.no_match",
                   .where = "item " + job.item_id,
                   .message = "Part " + job.part.id + " does not fit the scans: at the best pose " + number(100 * best.see_through_ratio, 1) +
                              " % of the readings pass through where the drawing has material (" + number(100 * kSeeThroughMax, 1) +
                              " % allowed); check that the scans are of this part and that nothing is missing from it.",
                   .measured = best.see_through_ratio,
                   .limit = kSeeThroughMax,
                   .unit = "ratio",
                   .stage = "locate"};
  return std::nullopt;
}

namespace {

/// Whether every edge to be worked comes to lie on an edge of the same recipe when the part moves.
bool features_are_the_same(const Job& job, const Pose<frame::Part, frame::Part>& motion) {
  constexpr double kSameMm = 0.5;
  std::map<std::string, std::vector<Vec3>> by_recipe;
  for (const FeatureSpec& f : job.part.features)
    for (const int e : f.edges) {
      auto& points = by_recipe[f.recipe];
      const auto& p = job.part.brep.edges[static_cast<std::size_t>(e)].p;
      for (std::size_t i = 0; i + 1 < p.size(); ++i) {
        const int parts = std::max(1, static_cast<int>((p[i + 1] - p[i]).norm() / 0.5));
        for (int j = 0; j <= parts; ++j) points.push_back(p[i] + (static_cast<double>(j) / parts) * (p[i + 1] - p[i]));
      }
    }
  for (const auto& [recipe, points] : by_recipe) {
    const PointGrid grid(points, 2.0);
    for (std::size_t i = 0; i < points.size(); i += 4)
      if (!grid.any_within(motion.point(points[i]), kSameMm)) return false;
  }
  return true;
}

/// Motions that two places may really differ by, the residual misfit of their two descents taken off: the multiple of the symmetry
/// where one is near; about an axis of any order the turns within a degree, nearest first.
std::vector<Pose<frame::Part, frame::Part>> cleaned(const Job& job, const Pose<frame::Part, frame::Part>& motion) {
  if (!job.part.symmetry) return {motion};
  const Vec3 axis = job.part.symmetry->axis_part.normalized();
  const Vec3 w = quat_log(motion.q);
  const double along = w.dot(axis);
  if ((w - along * axis).norm() > rad_from_deg(2.0)) return {motion};
  const auto turned = [&](double angle) -> Pose<frame::Part, frame::Part> {
    const Eigen::Quaterniond q(Eigen::AngleAxisd(angle, axis));
    return {q, job.part.symmetry->point_part - q * job.part.symmetry->point_part};
  };
  if (job.part.symmetry->order_count > 0) {
    const double pitch = 2 * kPi / job.part.symmetry->order_count, angle = pitch * std::round(along / pitch);
    return {std::abs(angle - along) > rad_from_deg(2.0) ? motion : turned(angle)};
  }
  std::vector<Pose<frame::Part, frame::Part>> out;
  for (int k = 0; k <= 10; ++k)
    for (const double side : {1.0, -1.0})
      if (k > 0 || side > 0) out.push_back(turned(along + side * k * rad_from_deg(0.1)));
  return out;
}

}  // namespace

std::optional<Refusal> check_ambiguity(const LocateRecipe& recipe, const Job& job, const CadModel& cad, const std::vector<Candidate>& found) {
  const Candidate& best = found.front();
  for (std::size_t i = 1; i < found.size(); ++i) {
    const Candidate& other = found[i];
    const double margin = best.log_likelihood - other.log_likelihood;
    if (margin >= recipe.margin_min) break;
    const double angle = best.T_base_part.q.angularDistance(other.T_base_part.q);
    const double shift = (best.T_base_part.point(cad.center_part) - other.T_base_part.point(cad.center_part)).norm();
    if (angle < kOtherAngleRad && shift < kOtherShiftMm) continue;
    const auto motions = cleaned(job, best.T_base_part.inverse() * other.T_base_part);
    if (std::any_of(motions.begin(), motions.end(), [&](const auto& m) { return features_are_the_same(job, m); })) continue;
    return Refusal{.code = "locate.ambiguous",
                   .where = "item " + job.item_id,
                   .message = "Two places fit the scans alike: the second is turned by " + number(deg_from_rad(angle), 1) + " deg and shifted by " +
                              number(shift, 1) + " mm, its log-likelihood only " + number(margin, 2) + " lower (" + number(recipe.margin_min, 1) +
                              " needed), and the edges to be worked are not the same in both. Scan the features that tell them apart.",
                   .measured = margin,
                   .limit = recipe.margin_min,
                   .unit = "log-likelihood",
                   .stage = "locate"};
  }
  return std::nullopt;
}

Mat6 play_information(const FixtureSpec& fixture, const Pose<frame::Base, frame::Part>& T_base_part, const Vec3& center_base) {
  const Pose<frame::Base, frame::Part> nominal = fixture.T_base_fixture * fixture.T_fixture_part;
  const double root3 = std::sqrt(3.0);
  Vec6 information;
  for (int a = 0; a < 3; ++a) {
    const double shift = std::max(0.5, fixture.play_mm[a]) / root3;
    const double turn = std::max(rad_from_deg(0.2), fixture.play_rad[static_cast<std::size_t>(a)].value_or(kPi)) / root3;
    information[a] = 1 / (shift * shift), information[a + 3] = 1 / (turn * turn);
  }
  // Shifts along the fixture's axes, turns about the nominal part's axes through the part's origin.
  const Mat3 Rf = fixture.T_base_fixture.rotation().transpose(), Rp = nominal.rotation().transpose();
  Mat6 to_play = Mat6::Zero();
  to_play.topLeftCorner<3, 3>() = Rf;
  to_play.topRightCorner<3, 3>() = -Rf * skew(T_base_part.p_mm - center_base);
  to_play.bottomRightCorner<3, 3>() = Rp;
  return to_play.transpose() * information.asDiagonal() * to_play;
}

void describe_observability(const CadModel& cad, const AdjustRequest& request, const Adjusted& adjusted, Location& location) {
  const Mat6 data = 0.5 * (adjusted.state.data_information + adjusted.state.data_information.transpose());
  Eigen::GeneralizedSelfAdjointEigenSolver<Mat6> solver(data, request.part_prior_information);
  location.singular_values.clear(), location.weak_directions.clear();
  for (int i = 5; i >= 0; --i) location.singular_values.push_back(std::max(0.0, solver.eigenvalues()[i]));
  const Pose<frame::Base, frame::Part>& T = adjusted.state.T_base_part;
  const double lever = 0.5 * cad.size_mm;
  for (int i = 0; i < 6; ++i) {
    if (solver.eigenvalues()[i] >= kInformationMin) break;
    const Vec6 v = solver.eigenvectors().col(i);
    const Vec3 t = T.rotation().transpose() * v.head<3>(), w = T.rotation().transpose() * v.tail<3>();
    const bool is_turn = lever * w.norm() > t.norm();
    const Vec3 d = is_turn ? w : t;
    int axis;
    d.cwiseAbs().maxCoeff(&axis);
    // The eigenvector has length one in the play's measure, so this is its standard deviation with play and data together.
    const double sd = d.norm() / std::sqrt(1 + std::max(0.0, solver.eigenvalues()[i]));
    location.weak_directions.push_back((is_turn ? "rotation about the part's " : "shift along the part's ") + std::string(1, "xyz"[axis]) +
                                       " axis: " + (is_turn ? number(deg_from_rad(sd), 2) + " deg" : number(sd, 2) + " mm") + " (1 sd)");
  }
}

std::optional<Refusal> check_enough(const Job& job, const Adjusted& adjusted) {
  if (adjusted.state.cluster_count < kCellsMin)
    return Refusal{.code = "locate.not_converged",
                   .where = "item " + job.item_id,
                   .message = "Only " + std::to_string(adjusted.state.cluster_count) + " places on the part's faces were read (" +
                              std::to_string(kCellsMin) + " needed to place it); scan it denser or from more sides.",
                   .measured = static_cast<double>(adjusted.state.cluster_count),
                   .limit = static_cast<double>(kCellsMin),
                   .unit = "cells",
                   .stage = "locate"};
  return std::nullopt;
}

std::optional<Refusal> check_converged(const Job& job, const Adjusted& adjusted) {
  if (!adjusted.is_converged)
    return Refusal{.code = "locate.not_converged",
                   .where = "item " + job.item_id,
                   .message = "The adjustment of the part's pose still moves by " + number(adjusted.state.step_mm, 3) +
                              " mm at its last step (0.020 mm allowed); scan more of the part's faces.",
                   .measured = adjusted.state.step_mm,
                   .limit = 0.02,
                   .unit = "mm",
                   .stage = "locate"};
  return std::nullopt;
}

std::optional<Refusal> check_observable(const Job& job, const Location& location) {
  if (!location.singular_values.empty() && location.singular_values.back() < kInformationMin)
    return Refusal{.code = "locate.unobservable",
                   .where = "item " + job.item_id,
                   .message = "The scans do not hold the part in " + std::to_string(location.weak_directions.size()) + " direction(s), first " +
                              (location.weak_directions.empty() ? std::string("unknown") : location.weak_directions.front()) +
                              "; scan faces that stand across this direction.",
                   .measured = location.singular_values.back(),
                   .limit = kInformationMin,
                   .unit = "ratio",
                   .stage = "locate"};
  return std::nullopt;
}

namespace {

/// Captures against each other and hand-eyes against their calibration.
std::optional<Refusal> check_consistency(const Job& job, const MeasuredCloud& cloud, const RobotPrior& prior, const AdjustRequest& request,
                                         const Adjusted& adjusted) {
  const std::vector<PairTest> pairs = pair_tests(prior, request, adjusted);
  const auto name = [&](int k) { return k < 0 ? std::string("none") : cloud.captures[static_cast<std::size_t>(k)].name; };
  const auto sensor_of = [&](int k) { return cloud.captures[static_cast<std::size_t>(k)].sensor; };
  const auto once_in = [](double p) { return p < 1e-9 ? std::string("more than 1e9") : number(1 / p, 0); };
  const auto asked = [&](double limit) { return " (rarer than once in " + number(1 / limit, 0) + " is taken for a fault)."; };
  std::optional<HandEyeTest> off;
  for (const HandEyeTest& t : hand_eye_tests(prior, adjusted))
    if (t.p < kHandEyeProbabilityMin && (!off || t.p < off->p)) off = t;
  const PairTest* worst = nullptr;
  for (const PairTest& t : pairs)
    if (!off || sensor_of(t.capture_1) == off->sensor || sensor_of(t.capture_2) == off->sensor)
      if (!worst || t.p < worst->p) worst = &t;
  const std::string between = worst ? ", captures " + name(worst->capture_1) + " and " + name(worst->capture_2) : "";
  const std::string apart = worst ? "Captures " + name(worst->capture_1) + " and " + name(worst->capture_2) + " see the same faces " + number(worst->apart_mm, 2) +
                                        " mm apart where robot and calibration allow " + number(worst->allowed_mm, 2) + " mm (1 sd). "
                                  : "";
  if (off) {
    int axis;
    off->shift_mm.cwiseQuotient(off->shift_sd_mm.cwiseMax(1e-6)).cwiseAbs().maxCoeff(&axis);
    return Refusal{.code = "locate.captures_contradict",
                   .where = "item " + job.item_id + between,
                   .message = apart + "The calibration of sensor " + job.cell.sensors[static_cast<std::size_t>(off->sensor)].id +
                              " does not fit the scans: by them alone its mount would be off by " + number(off->shift_mm[axis], 2) + " mm along " +
                              std::string(1, "xyz"[axis]) + " of its frame (1 sd " + number(off->shift_sd_mm[axis], 2) +
                              " mm). A sound cell looks like this once in " + once_in(off->p) + " jobs" + asked(kHandEyeProbabilityMin) +
                              " Check the sensor's mount and the poses in the scan file, calibrate the sensor again, then scan again.",
                   .measured = off->p,
                   .limit = kHandEyeProbabilityMin,
                   .unit = "probability",
                   .stage = "locate"};
  }
  const double pair_limit = kPairsProbabilityMin / static_cast<double>(std::max<std::size_t>(1, pairs.size()));
  if (worst && worst->p < pair_limit)
    return Refusal{.code = "locate.captures_contradict",
                   .where = "item " + job.item_id + between,
                   .message = apart + "A sound cell shows such a pair once in " + once_in(worst->p) + asked(pair_limit) +
                              " See that the part was not moved between the two; check their poses in the scan file and the sensor's mount, then scan again.",
                   .measured = worst->p,
                   .limit = pair_limit,
                   .unit = "probability",
                   .stage = "locate"};
  return std::nullopt;
}

}  // namespace

std::optional<Refusal> check_adjusted(const Job& job, const MeasuredCloud& cloud, const RobotPrior& prior, const AdjustRequest& request,
                                      const Adjusted& adjusted, const Location& location) {
  if (auto refusal = check_consistency(job, cloud, prior, request, adjusted)) return refusal;
  return check_play(job, location.T_base_part);
}

std::optional<Refusal> check_play(const Job& job, const Pose<frame::Base, frame::Part>& T_base_part) {
  const std::string item = "item " + job.item_id;
  // Play: a little more is let through than asked, because the fixture's own place is known to the robot's accuracy only.
  const Pose<frame::Base, frame::Part> nominal = job.fixture.T_base_fixture * job.fixture.T_fixture_part;
  const Vec3 shift = job.fixture.T_base_fixture.rotation().transpose() * (T_base_part.p_mm - nominal.p_mm);
  const Mat3 R = (nominal.q.conjugate() * T_base_part.q).toRotationMatrix();
  const Vec3 angles(std::atan2(R(2, 1), R(2, 2)), std::asin(std::clamp(-R(2, 0), -1.0, 1.0)), std::atan2(R(1, 0), R(0, 0)));
  const double extra_mm = 1.0 + 2 * job.cell.robot.accuracy.absolute.mean_mm, extra_rad = rad_from_deg(0.3);
  for (int a = 0; a < 3; ++a) {
    if (std::abs(shift[a]) > job.fixture.play_mm[a] + extra_mm)
      return Refusal{.code = "locate.outside_play",
                     .where = item + ", fixture " + std::string(1, "xyz"[a]),
                     .message = "The part sits " + number(shift[a], 2) + " mm along the fixture's " + std::string(1, "xyz"[a]) +
                                " axis, its play is " + number(job.fixture.play_mm[a], 2) + " mm; seat it in the fixture or correct the fixture's pose.",
                     .measured = std::abs(shift[a]),
                     .limit = job.fixture.play_mm[a],
                     .unit = "mm",
                     .stage = "locate"};
    const auto& play = job.fixture.play_rad[static_cast<std::size_t>(a)];
    if (play && std::abs(angles[a]) > *play + extra_rad)
      return Refusal{.code = "locate.outside_play",
                     .where = item + ", about " + std::string(1, "xyz"[a]),
                     .message = "The part is turned " + number(deg_from_rad(angles[a]), 2) + " deg about its " + std::string(1, "xyz"[a]) +
                                " axis, its play is " + number(deg_from_rad(*play), 2) + " deg; seat it in the fixture or correct the fixture's pose.",
                     .measured = deg_from_rad(std::abs(angles[a])),
                     .limit = deg_from_rad(*play),
                     .unit = "deg",
                     .stage = "locate"};
  }
  return std::nullopt;
}

}  // namespace asbuilt
