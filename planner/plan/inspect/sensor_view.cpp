// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/inspect/sensor_view.hpp"

#include <cmath>

#include "planner/base/number.hpp"

namespace asbuilt::inspecting {

namespace {

constexpr double kPixelsAcross = 300, kIncidence_rad = rad_from_deg(68), kSecondEye_ratio = 0.45;
constexpr double kLift_mm = 0.02;  // rays start this far above the face

}  // namespace

std::string_view name_of(Unseen u) {
  switch (u) {
    case Unseen::seen: return "seen";
    case Unseen::out_of_field: return "out of the field";
    case Unseen::out_of_range: return "out of range";
    case Unseen::too_steep: return "too steep";
    case Unseen::hidden: return "hidden";
    default: return "hidden from the second eye";
  }
}

SensorEye eye_of(const SensorSpec& s) {
  SensorEye e;
  e.working_distance_mm = s.working_distance_mm > 0 ? s.working_distance_mm : 0.5 * (s.range_mm[0] + s.range_mm[1]);
  for (std::size_t k = 0; k < 2; ++k) e.half_width_ratio[k] = 0.5 * s.field_of_view_mm[k] / e.working_distance_mm;
  e.range_mm = s.range_mm;
  e.noise_mm = s.noise_mm;
  const auto assume = [&](const std::string& what) { e.assumed.push_back("sensor " + s.id + ": " + what); };
  if (s.pixels_count) {
    e.pitch_ratio = std::sqrt(s.field_of_view_mm[0] / (*s.pixels_count)[0] * s.field_of_view_mm[1] / (*s.pixels_count)[1]) / e.working_distance_mm;
  } else {
    e.pitch_ratio = s.field_of_view_mm[0] / kPixelsAcross / e.working_distance_mm;
    assume("no pixels are given; " + fixed_number(kPixelsAcross, 0) + " across the field were assumed");
  }
  if (!s.incidence_max_rad) assume("no incidence is given; " + fixed_number(deg_from_rad(kIncidence_rad), 0) + " degrees were assumed");
  e.cos_incidence_min_ratio = std::cos(s.incidence_max_rad.value_or(kIncidence_rad));
  if (!s.second_ray_mm) assume("no second_ray is given; " + fixed_number(kSecondEye_ratio * e.working_distance_mm, 0) + " mm along its x were assumed");
  e.second_mm = s.second_ray_mm.value_or(Vec3(kSecondEye_ratio * e.working_distance_mm, 0, 0));
  e.has_second = e.second_mm.norm() > 1e-9;
  return e;
}

Unseen look(const SensorEye& eye, const Blockers& blockers, const Stand& stand, const Patch& patch, double margin, double& density) {
  density = 0;
  const Vec3 p_sensor = stand.T_base_sensor.inverse().point(patch.p);
  const double z = p_sensor.z();
  if (z - margin < eye.range_mm[0] || z + margin > eye.range_mm[1]) return Unseen::out_of_range;
  for (int k = 0; k < 2; ++k)
    if (std::abs(p_sensor[k]) + margin > eye.half_width_ratio[static_cast<std::size_t>(k)] * z) return Unseen::out_of_field;
  const Vec3 from = patch.p + kLift_mm * patch.n;
  const Vec3 eyes[2] = {stand.T_base_sensor.p_mm, stand.T_base_sensor.point(eye.second_mm)};
  const int count = eye.has_second ? 2 : 1;
  double cos_first = 0;
  for (int k = 0; k < count; ++k) {
    const double c = patch.n.dot((eyes[k] - from).normalized());
    if (k == 0) cos_first = c;
    if (c < eye.cos_incidence_min_ratio) return Unseen::too_steep;
  }
  for (int k = 0; k < count; ++k) {
    const Vec3 way = eyes[k] - from;
    const double length = way.norm();
    const Vec3 d = way / length;
    bool is_hidden = blockers.standing_base.is_blocked(from, d, 1e-4, length);
    if (!is_hidden && stand.T_base_flange && static_cast<std::size_t>(stand.sensor) < blockers.riding_flange.size()) {
      const RayTree& tree = blockers.riding_flange[static_cast<std::size_t>(stand.sensor)];
      if (!tree.is_empty()) {
        const auto T = stand.T_base_flange->inverse();
        is_hidden = tree.is_blocked(T.point(from), T.direction(d), 1e-4, length);
      }
    }
    if (!is_hidden && stand.link_motion)
      for (const auto& [link, tree] : blockers.links) {
        const auto T = (*stand.link_motion)[static_cast<std::size_t>(link)].inverse();
        if (tree.is_blocked(T.point(from), T.direction(d), 1e-4, length)) {
          is_hidden = true;
          break;
        }
      }
    if (is_hidden) return k == 0 ? Unseen::hidden : Unseen::hidden_from_second;
  }
  const double pitch = eye.pitch_ratio * z;
  density = cos_first / (z / p_sensor.norm() * pitch * pitch);
  return Unseen::seen;
}

}  // namespace asbuilt::inspecting
