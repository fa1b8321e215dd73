// SPDX-License-Identifier: GPL-3.0-or-later
// Where the part may sit, without any guess beyond the fixture's nominal pose and play: many starts, a slow descent on the
// drawing's distance grid, and a look along every ray to decide between what is left. Where the fixture leaves the turn open the
// starts are votes of the readings, for every rotation.
#pragma once

#include <vector>

#include "planner/locate/cad_model.hpp"
#include "planner/locate/rays.hpp"
#include "planner/locate/scene.hpp"
#include "planner/locate/vote.hpp"

namespace asbuilt {

/// Two or three free angles: nothing is known of the turn.
bool is_free(const FixtureSpec& fixture);

/// The same fixture with the part anywhere in it: every turn, shifts by up to room_mm.
FixtureSpec opened(FixtureSpec fixture, double room_mm);

/// Every start that the fixture leaves open: bounded angles in steps of 8 deg, a free angle in steps of 1 deg. For fixtures
/// that are not is_free.
std::vector<Pose<frame::Base, frame::Part>> starts(const FixtureSpec& fixture);

/// Frames: base. Best first by score; duplicates (4 deg and 4 mm at the part's center) are merged, the better kept. Where the
/// fixture is_free: rotations spread evenly, shifts for each by votes of the readings (see Ballot), the best candidates descend
/// slowly; every pseudo-symmetry of the winners is tried too. Needs prepare_free_search then.
std::vector<Candidate> descend(const CadModel& cad, const Scene& scene, const FixtureSpec& fixture);

/// Where the distance grid does not hold a free angle (only outlines would), turns the candidate by up to 4 deg to its best
/// likelihood along rays.
void settle_turn(const CadModel& cad, const Scene& scene, const FixtureSpec& fixture, const std::vector<Vec3>& sensor_base, std::size_t rays_max,
                 Candidate& candidate);

/// The whole search: descend, then likelihoods along rays, best first; what comes close to the best is compared with it by all rays
/// (see preference). Where the fixture is_free the pseudo-symmetric alternatives of the two best are looked at once more.
std::vector<Candidate> find_candidates(const CadModel& cad, const Scene& scene, const FixtureSpec& fixture, const std::vector<Vec3>& sensor_base);

}  // namespace asbuilt
