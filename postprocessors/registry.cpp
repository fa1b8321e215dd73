// SPDX-License-Identifier: GPL-3.0-or-later
// The table of posts: a new dialect is one folder and one row here.
#include "postprocessors/beckhoff/beckhoff.hpp"
#include "postprocessors/inform/inform.hpp"
#include "postprocessors/krl/krl.hpp"
#include "postprocessors/nci/nci.hpp"
#include "postprocessors/post.hpp"
#include "postprocessors/ur/ur.hpp"

namespace asbuilt {
namespace {

constexpr double kAngleStep_rad = 1e-4 * kPi / 180.0;

JointVector degree_step(const PostContext&) {
  JointVector step;
  step.fill(kAngleStep_rad);
  return step;
}
JointVector radian_step(const PostContext&) {
  JointVector step;
  step.fill(1e-7);
  return step;
}
JointVector pulse_step(const PostContext& context) {
  JointVector step{};
  if (const auto& p = context.cell.controller.pulses_per_degree)
    for (int i = 0; i < 6; ++i) step[i] = rad_from_deg(1.0 / std::abs((*p)[i]));
  return step;
}

}  // namespace

const std::vector<Post>& posts() {
  static const std::vector<Post> table = {
      {Language::krl, "KUKA KRL (KRC2, KRC4)", ".src", 0.001, kAngleStep_rad, 0.001, krl::write, krl::read, krl::lint, degree_step, 0.01, 1e-5,
       0.001, 0.001, Post::Arcs::anywhere, true},
      {Language::inform, "Yaskawa INFORM (DX, YRC)", ".JBI", 0.001, kAngleStep_rad, 0.1, inform::write, inform::read, inform::lint, pulse_step, 1e-4,
       1e-4, 0.01, 0.1},
      {Language::beckhoff, "Beckhoff TwinCAT CNC", ".nc", 0.001, kAngleStep_rad, 0.01 / 60, beckhoff::write, beckhoff::read, beckhoff::lint,
       degree_step, 1e-5, 1e-4, 0.001, 0.001, Post::Arcs::in_planes_of_the_frame},
      {Language::nci, "Beckhoff TwinCAT NC I", ".nc", 0.001, kAngleStep_rad, 0.01 / 60, nci::write, nci::read, nci::lint, degree_step, 1e-5, 1e-4,
       0.001, 0.001, Post::Arcs::in_planes_of_base, false, false, false, true, true},
      {Language::ur, "UR script", ".script", 0.001, 1e-7, 0.001, ur::write, ur::read, ur::lint, radian_step, 1e-6, 1e-5, 0.001, 0.001,
       Post::Arcs::anywhere, false, true, false, false, true},
  };
  return table;
}

const Post* find_post(Language language) {
  for (const Post& p : posts())
    if (p.language == language) return &p;
  return nullptr;
}

}  // namespace asbuilt
