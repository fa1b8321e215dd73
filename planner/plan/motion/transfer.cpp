// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/motion/transfer.hpp"

#include <algorithm>
#include <array>

#include "planner/plan/motion/pass_search.hpp"
#include "planner/robot/free_move.hpp"

namespace asbuilt {

namespace {

/// The posture raised straight up in base, or none.
std::optional<JointVector> raised(const PassTools& tools, const JointVector& q, double up_mm) {
  auto T = tools.robot->forward(q);
  T.p_mm.z() += up_mm;
  const auto r = tools.robot->inverse_near(T, q);
  if (!r || largest_joint_step(*r, q) > 1.0 || tools.robot->joint_margin_rad(*r) < tools.joint_margin_rad) return std::nullopt;
  return r;
}

}  // namespace

Result<Transfer> plan_transfer(const JointVector& q_from, const JointVector& q_to, const PassTools& tools, const std::vector<Watch>& watches,
                               int iterations_count, const std::string& where) {
  const CollisionScene& scene = tools.cell->scene;
  const Certificate straight = scene.certify(watches, {{q_from, q_to}, false});
  if (straight.is_free) return Transfer{{q_from, q_to}, straight.clearance_mm};
  const auto certified = [&](const std::vector<JointVector>& q) -> std::optional<Transfer> {
    const Certificate c = scene.certify(watches, {q, false});
    if (!c.is_free) return std::nullopt;
    return Transfer{q, c.clearance_mm};
  };
  const JointVector home = tools.robot->spec().home_rad;
  for (const double up : {50.0, 100.0, 200.0, 400.0}) {
    const auto a = raised(tools, q_from, up), b = raised(tools, q_to, up);
    std::vector<std::vector<JointVector>> ways;
    if (a && b) ways.push_back({q_from, *a, *b, q_to});
    if (a) ways.push_back({q_from, *a, q_to});
    if (b) ways.push_back({q_from, *b, q_to});
    if (a && b) ways.push_back({q_from, *a, home, *b, q_to});
    for (const auto& w : ways)
      if (auto t = certified(w)) return *t;
  }
  if (iterations_count > 0)
    if (auto q = find_free_move(scene, watches, q_from, q_to, iterations_count))
      if (auto t = certified(*q)) return *t;
  const Watch& w = watches[static_cast<std::size_t>(straight.watch)];
  return refuse({.code = "motion.no_transfer",
                 .where = where,
                 .message = "no free move was found: on the straight one " + pair_name(*tools.cell, w) + " come within " + text_mm(straight.clearance_mm) +
                            " mm (" + text_mm(w.margin_mm) + " mm are wanted) near base " + text_point(straight.p_base) +
                            "; move what is in the way, choose another home, or allow more planner_iterations",
                 .measured = straight.clearance_mm, .limit = w.margin_mm, .unit = "mm", .stage = "motion"});
}

}  // namespace asbuilt
