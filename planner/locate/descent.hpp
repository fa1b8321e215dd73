// SPDX-License-Identifier: GPL-3.0-or-later
// The descent of a scan onto the drawing's distance grid: robust steps of point to plane from a start, pulled back softly by the
// fixture. Frame: base.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "planner/locate/cad_model.hpp"
#include "planner/locate/rays.hpp"
#include "planner/locate/scene.hpp"

namespace asbuilt {

struct Descent {
  const CadModel& cad;
  const Scene& scene;
  Pose<frame::Base, frame::Part> nominal;
  Vec3 play_mm;
  std::array<std::optional<double>, 3> play_rad;
  bool is_held = true;  // by the fixture

  /// One damped step of point to plane with the first `count` points of the scene; returns the mean score at the pose it was given.
  double step(Pose<frame::Base, frame::Part>& T, std::size_t count, double reach_mm) const;

  /// Mean over points of 1 - (d / 14 mm)^2, none below zero.
  double score(const Pose<frame::Base, frame::Part>& T, std::size_t count) const;

  /// `steps` steps for each reach, coarse to fine.
  Candidate descend_from(Pose<frame::Base, frame::Part> T, std::size_t count, const std::vector<double>& reaches, int steps) const;
};

/// Best first by score; of places within 4 deg and 4 mm at the part's center the best is kept; at most `most` of them.
void keep_best(std::vector<Candidate>& all, const Vec3& center_part, std::size_t most);

}  // namespace asbuilt
