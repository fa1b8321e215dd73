// SPDX-License-Identifier: GPL-3.0-or-later
// The published system's setting, for the studies and the bench: its poses and wider ones, the seam it measures to prove itself, starts
// that are off.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "planner/calibrate/profilometer_observe.hpp"
#include "planner/calibrate/profilometer_start.hpp"
#include "tests/support/profilometer_rig.hpp"

namespace asbuilt::published_setting {

struct Setting {
  const char* name;
  double tilt_deg;
  bool has_roll, is_both_ways;
};
inline const Setting kSettings[] = {{"published: 15 poses, 10 deg, one way", 10, false, false},
                             {"15 poses, 10 deg, both ways", 10, false, true},
                             {"15 poses, 30 deg, both ways", 30, false, true},
                             {"45 poses, 30 deg, turned 0/90/180, both ways", 30, true, true}};

inline std::vector<simulate::ProfilometerPass> all_passes(const simulate::ProfilometerCell& c, const Setting& s) {
  auto passes = rig::passes_of(c, simulate::published_stands(rad_from_deg(s.tilt_deg), s.has_roll, s.is_both_ways));
  for (const auto& p : rig::held_out_passes(c, rad_from_deg(s.tilt_deg), s.is_both_ways, passes.back().pose + 1)) passes.push_back(p);
  return passes;
}

inline ProfilometerRecipe recipe_for(const simulate::ProfilometerCell& c, const Setting& s) {
  ProfilometerRecipe r = rig::recipe_of(c);
  if (!s.is_both_ways) r.latency = LatencyChoice::known, r.latency_s = c.latency_s, r.latency_sd_s = 1e-5;
  r.field_sd_max_mm = 1;
  return r;
}

inline ProfilometerProblem problem_of(const ProfilometerRecipe& r, const HolePlate& plate, const std::vector<HoleView>& views) {
  ProfilometerProblem p{&r, &plate, {}, camera_parameters(rig::sheet())};
  for (const PoseGroup& g : grouped(views))
    if (!g.is_held_out) p.groups.push_back(g);
  return p;
}

/// A seam seen from seven poses (reference, higher, lower, tilted either way about both axes): difference of its place to the reference.
/// Rows: y and z of the plate's frame for six poses; J by the parameters.
struct Seam {
  Eigen::VectorXd place;
  Eigen::MatrixXd J;
};
inline Seam seam_of(const simulate::ProfilometerCell& c, const ProfilometerState& s) {
  const double t = rad_from_deg(8);
  const std::vector<simulate::ProfilometerStand> stands{{0}, {30}, {-30}, {0, t}, {0, -t}, {0, 0, t}, {0, 0, -t}};
  Eigen::Matrix<double, 2, Eigen::Dynamic> J_reference;
  Vec2 reference = Vec2::Zero();
  Seam out{Eigen::VectorXd(12), Eigen::MatrixXd(12, s.intrinsics.values.size() + 13)};
  const Vec3 middle = 0.5 * (hole_center(c.plate, 0, 0) + hole_center(c.plate, c.plate.columns_count - 1, c.plate.rows_count - 1));
  for (std::size_t k = 0; k < stands.size(); ++k) {
    const auto pass = simulate::pass_of(c, stands[k], 0, 100, 40);
    // the seam's point crosses the light half way: true pixel, true flange
    const auto T_base_flange = Pose<frame::Base, frame::Flange>(pass.T_base_flange.q, pass.T_base_flange.p_mm + 50 * pass.velocity_base_mm_s.normalized());
    const Vec3 p_sensor = (T_base_flange * c.T_flange_sensor).inverse().point(c.T_base_target.point(middle));
    const Vec3 way = (T_base_flange * c.T_flange_sensor).q.conjugate() * pass.velocity_base_mm_s.normalized();
    const double by = p_sensor.y() / way.y();
    const Vec3 q = p_sensor - way * by;
    Vec2 uv;
    simulate::project(c.device, {q.x(), q.z()}, uv);
    Eigen::Matrix<double, 3, Eigen::Dynamic> J;
    const Vec3 p_flange = flange_point(s, uv, &J);
    const Mat3 R = (c.T_base_target.q.conjugate() * T_base_flange.q).toRotationMatrix();
    const Vec2 place = (R * p_flange + c.T_base_target.q.conjugate() * (T_base_flange.p_mm + by * pass.velocity_base_mm_s.normalized())).tail<2>();
    const Eigen::Matrix<double, 2, Eigen::Dynamic> Jk = (R * J).bottomRows<2>();
    if (k == 0) {
      reference = place, J_reference = Jk;
      continue;
    }
    out.place.segment<2>(2 * Eigen::Index(k - 1)) = place - reference;
    out.J.middleRows(2 * Eigen::Index(k - 1), 2) = Jk - J_reference;
  }
  return out;
}

/// A start whose numbers are all off by up to `ratio` of themselves: lens and plane, hand-eye, target.
inline ProfilometerState disturbed(const ProfilometerState& truth, double ratio, Random& random) {
  ProfilometerState s = truth;
  auto off = [&] { return 1 + random.uniform(-ratio, ratio); };
  for (double& v : s.intrinsics.values) v *= off();
  s.intrinsics.values[1] = truth.intrinsics.values[1], s.intrinsics.values[2] = truth.intrinsics.values[2];  // the pixel is known
  auto pose = [&](auto& T) {
    for (double& v : T.p_mm) v *= off();
    const Vec3 w = quat_log(T.q);
    T.q = quat_exp(Vec3(w.x() * off(), w.y() * off(), w.z() * off()));
  };
  pose(s.T_flange_sensor), pose(s.T_base_target);
  return s;
}

}  // namespace asbuilt::published_setting
