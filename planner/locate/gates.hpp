// SPDX-License-Identifier: GPL-3.0-or-later
// When the location is refused, with the number that decided and what to do next.
#pragma once

#include <optional>
#include <vector>

#include "planner/locate/adjust.hpp"
#include "planner/locate/locate.hpp"
#include "planner/locate/search.hpp"

namespace asbuilt {

/// locate.no_match: the best hypothesis does not look like the scan.
std::optional<Refusal> check_match(const LocateRecipe& recipe, const Job& job, const std::vector<Candidate>& found);

/// locate.ambiguous: another hypothesis explains the scan as well, and the edges to be worked are not the same under the motion.
std::optional<Refusal> check_ambiguity(const LocateRecipe& recipe, const Job& job, const CadModel& cad, const std::vector<Candidate>& found);

/// Information of the fixture's play about the part's twist (base, about center): half ranges as uniform, free angles as a turn.
Mat6 play_information(const FixtureSpec& fixture, const Pose<frame::Base, frame::Part>& T_base_part, const Vec3& center_base);

/// Fills singular_values and weak_directions: generalised eigenproblem of the data's information against the play's.
void describe_observability(const CadModel& cad, const AdjustRequest& request, const Adjusted& adjusted, Location& location);

/// locate.not_converged: too little to adjust.
std::optional<Refusal> check_enough(const Job& job, const Adjusted& adjusted);

/// locate.unobservable: a direction that the data do not hold better than the play, in words. Needs describe_observability.
std::optional<Refusal> check_observable(const Job& job, const Location& location);

/// locate.not_converged: the last step was still long.
std::optional<Refusal> check_converged(const Job& job, const Adjusted& adjusted);

/// locate.captures_contradict, locate.outside_play.
std::optional<Refusal> check_adjusted(const Job& job, const MeasuredCloud& cloud, const RobotPrior& prior, const AdjustRequest& request,
                                      const Adjusted& adjusted, const Location& location);

/// locate.outside_play. A little more is let through than asked, because the fixture's own place is known to the robot's accuracy only.
std::optional<Refusal> check_play(const Job& job, const Pose<frame::Base, frame::Part>& T_base_part);

}  // namespace asbuilt
