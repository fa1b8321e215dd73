// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 3: captures -> one measured cloud in base, with normals and sigma. Edges and burrs are kept.
#pragma once

#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/base/result.hpp"
#include "planner/fuse/streams.hpp"

namespace asbuilt {

struct FuseRecipe {
  int normal_neighbours_count = 20;
  double outlier_ratio = 4.0;        // a point is an outlier beyond this many robust sd of its neighbours' mean distance
  int min_points_count = 500;        // of one item, all captures together
  StreamRecipe stream;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("normal_neighbours", s.normal_neighbours_count), a("outlier_ratio", s.outlier_ratio), a("min_points", s.min_points_count);
    a("stream", s.stream);
  }
};

/// Frames in: clouds in their sensor's frame, commanded flange poses in base. out: base. A stream (see streams.hpp) gives one capture of
/// the cloud for every view; `frames` gives its images and is needed only where the job has such a stream.
/// Refuses fuse.no_points, fuse.too_few_points, fuse.not_calibrated, and what fuse_stream refuses.
Result<Done<MeasuredCloud>> fuse(const FuseRecipe& recipe, const Job& job, const FrameSource& frames = {});

}  // namespace asbuilt
