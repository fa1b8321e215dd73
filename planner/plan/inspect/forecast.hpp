// SPDX-License-Identifier: GPL-3.0-or-later
// What a set of views will give for every edge: coverage, and how well the chamfer's leg can be known from them.
#pragma once

#include <vector>

#include "planner/plan/inspect/views.hpp"
#include "planner/robot/error_model.hpp"

namespace asbuilt::inspecting {

/// Forecast of every edge from the chosen views (any order; more views never give less).
///
/// Method    a face's offset at the edge from N points (10 mm of the edge, neighbours that share noise counted once) in a band of
///           width w that begins a from the edge: sigma / sqrt(N) * sqrt(1 + 12 (a + w/2)^2 / w^2), views added by information. Both
///           faces to the bisector as in algorithms B6.4. On top, of the best view: mount, the arm's error between its posture and
///           the working one, scatter of both motions; and the tool.
std::vector<EdgeForecast> forecast(const Workshop& shop, const RobotErrorModel& errors, const std::vector<const ViewCandidate*>& views);

/// The same of one edge alone (index into Workshop::edges).
EdgeForecast forecast_edge(const Workshop& shop, const RobotErrorModel& errors, const std::vector<const ViewCandidate*>& views, std::size_t edge);

}  // namespace asbuilt::inspecting
