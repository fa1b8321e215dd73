// SPDX-License-Identifier: GPL-3.0-or-later
// What it costs to cut in another posture than the one the edges were measured for. Adapted points are true commands near the
// reference tool pose of their feature; a tool tilted away from it brings in the arm's error of the other posture. Frame: part, mm^2.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"

namespace asbuilt {

class PostureError {
 public:
  PostureError(const Job& job, const Location& location, const Features& features);
  ~PostureError();
  PostureError(PostureError&&) noexcept;
  /// Covariance of the tip's place with the tool's axis at `up_part` relative to the feature's reference orientation at the same place.
  /// Zero within half a degree of it, where there is no reference, and where the arm does not reach (motion refuses that).
  Mat3 covariance(const ToolSpec& tool, const std::string& feature, const Vec3& tip_part, const Vec3& up_part) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace asbuilt
