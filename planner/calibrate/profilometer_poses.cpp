// SPDX-License-Identifier: GPL-3.0-or-later
// Which poses to add: a candidate's information with its own robot error marginalised, chosen greedily by what it does to the points of
// the field. Holes are predicted with the calibrated map; those outside the box of pixels seen so far do not count.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>

#include "planner/calibrate/profilometer_observe.hpp"

namespace asbuilt {
namespace {

/// The pass over the plate as the sensor would see it; holes outside the box lo..hi are not seen.
HoleView predicted(const ProfilometerProblem& problem, const ProfilometerState& s, const PoseCandidate& c, bool is_back, double speed_mm_s, const Vec2& lo,
                   const Vec2& hi) {
  HoleView v;
  v.name = c.name;
  const HolePlate& plate = *problem.plate;
  const auto T_sensor_target = c.T_target_sensor.inverse();
  const Vec3 way_sensor = T_sensor_target.direction(c.way_target) * (is_back ? -1.0 : 1.0);
  const auto T_base_flange = s.T_base_target * c.T_target_sensor * s.T_flange_sensor.inverse();
  const Vec3 way_base = s.T_base_target.direction(c.way_target) * (is_back ? -1.0 : 1.0);
  Vec2 uv = 0.5 * (lo + hi);
  for (int row = 0; row < plate.rows_count; ++row)
    for (int column = 0; column < plate.columns_count; ++column) {
      const Vec3 p = T_sensor_target.point(hole_center(plate, column, row));
      const double way = p.y() / way_sensor.y();
      const Vec3 q = p - way_sensor * way;
      Vec2 at;
      if (!pixel_of(s.intrinsics, {q.x(), q.z()}, uv, at)) continue;
      if ((at - lo).minCoeff() < 0 || (hi - at).minCoeff() < 0) continue;
      uv = at;
      HoleSighting h;
      h.column = column, h.row = row, h.uv = at;
      h.velocity_base_mm_s = way_base * speed_mm_s;
      // true flange at that moment; what is commanded lies a latency before
      h.T_base_flange = {T_base_flange.q, T_base_flange.p_mm + way_base * way - h.velocity_base_mm_s * s.latency_s};
      v.holes.push_back(h);
    }
  return v;
}

}  // namespace

std::vector<PoseCandidate> pose_candidates(const HolePlate& plate, const std::vector<double>& offsets_mm) {
  Mat3 level;
  level << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  const Vec3 middle = 0.5 * (hole_center(plate, 0, 0) + hole_center(plate, plate.columns_count - 1, plate.rows_count - 1));
  std::vector<PoseCandidate> all;
  for (const double roll : {0.0, 90.0, 180.0, 270.0})
    for (const double offset : offsets_mm)
      for (const double tilt : {0.0, 10.0, 20.0, 30.0})
        for (const auto& [x, y] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
          if (tilt == 0 && (x != 1 || y != 0)) continue;
          PoseCandidate c;
          const Eigen::Quaterniond q = Eigen::AngleAxisd(rad_from_deg(roll), Vec3::UnitZ()) * Eigen::Quaterniond(level) *
                                       Eigen::AngleAxisd(rad_from_deg(tilt * x), Vec3::UnitX()) * Eigen::AngleAxisd(rad_from_deg(tilt * y), Vec3::UnitY());
          c.T_target_sensor = {q, middle - q * Vec3(0, 0, offset)};
          c.way_target = Eigen::AngleAxisd(rad_from_deg(roll), Vec3::UnitZ()) * Vec3::UnitX();
          c.name = fmt::format("plate at {:.0f} mm, tilt {:.0f} deg about sensor x and {:.0f} deg about y, turned by {:.0f} deg", offset, tilt * x, tilt * y, roll);
          all.push_back(c);
        }
  return all;
}

std::vector<PoseSuggestion> poses_to_add(const ProfilometerProblem& problem, const ProfilometerState& state, const std::vector<Vec2>& field,
                                         const std::vector<PoseCandidate>& candidates, double field_sd_mm, std::size_t count_max, double speed_mm_s,
                                         const std::function<bool(const FlangePose&)>& is_reachable) {
  Vec2 lo = Vec2::Constant(1e300), hi = -lo;
  for (const PoseGroup& g : problem.groups)
    for (const HoleView* v : g.passes)
      for (const HoleSighting& h : v->holes) lo = lo.cwiseMin(h.uv), hi = hi.cwiseMax(h.uv);
  struct Option {
    const PoseCandidate* candidate;
    FlangePose T_base_flange;
    Eigen::MatrixXd information;
    std::size_t hole_count;
  };
  std::vector<Option> options;
  for (const PoseCandidate& c : candidates) {
    const FlangePose at = state.T_base_target * c.T_target_sensor * state.T_flange_sensor.inverse();
    if (is_reachable && !is_reachable(at)) continue;
    std::vector<HoleView> passes{predicted(problem, state, c, false, speed_mm_s, lo, hi)};
    if (c.is_both_ways) passes.push_back(predicted(problem, state, c, true, speed_mm_s, lo, hi));
    if (passes[0].holes.size() < 12) continue;
    ProfilometerProblem one = problem;
    one.weights.clear();
    one.groups = {{c.name, {}, false}};
    for (const HoleView& v : passes) one.groups[0].passes.push_back(&v);
    options.push_back({&c, at, information_of(one, state).data, passes[0].holes.size()});
  }
  const Eigen::VectorXd size = parameter_table(problem).size;
  Information now = information_of(problem, state);
  std::vector<Eigen::Matrix<double, 3, Eigen::Dynamic>> J(field.size());
  for (std::size_t i = 0; i < field.size(); ++i) flange_point(state, field[i], &J[i]);
  auto spread = [&](const Eigen::MatrixXd& C) {
    double sum = 0;
    for (const auto& Ji : J) sum += (Ji * C).cwiseProduct(Ji).sum();
    return sum;
  };
  std::vector<PoseSuggestion> out;
  std::vector<bool> is_taken(options.size(), false);
  while (out.size() < count_max) {
    if (field_quality(state, covariance_of(now, size), field).median_sd_mm.maxCoeff() <= field_sd_mm) break;
    std::size_t best = options.size();
    double best_spread = 1e300;
    for (std::size_t i = 0; i < options.size(); ++i) {
      if (is_taken[i]) continue;
      Information with = now;
      with.data += options[i].information;
      const double s = spread(covariance_of(with, size));
      if (s < best_spread) best_spread = s, best = i;
    }
    if (best == options.size()) break;
    is_taken[best] = true;
    now.data += options[best].information;
    PoseSuggestion p{*options[best].candidate, options[best].T_base_flange, options[best].hole_count, 0};
    p.field_sd_mm = field_quality(state, covariance_of(now, size), field).median_sd_mm.maxCoeff();
    out.push_back(p);
  }
  return out;
}

}  // namespace asbuilt
