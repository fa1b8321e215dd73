// SPDX-License-Identifier: GPL-3.0-or-later
// Streams of a moving sensor: clocks matched, frames placed, readings thinned without losing edges; and the surface of a stream.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/base/result.hpp"
#include "planner/geom/mesh.hpp"

namespace asbuilt {

/// A depth image, row by row; 0: no reading.
struct DepthPixels {
  int width_px = 0, height_px = 0;
  std::vector<std::uint16_t> depth_count;
};
/// Gives a frame of a stream when it is asked for; called from several threads.
using FrameSource = std::function<Result<DepthPixels>(const StreamFrame& frame)>;

struct StreamRecipe {
  double gap_max_s = 0.020;             // lost packets are bridged up to this
  double cut_max_ratio = 0.10;          // of the frames may be cut because the robot's place is not known
  double offset_max_s = 0.050;          // clocks said to be common may be this far apart; it is corrected, and said
  double offset_quiet_s = 0.003;        // below it is not worth a word
  double agree_sigma_ratio = 3.0;       // flash and motion must agree within so many sd
  double motion_error_max_mm = 0.05;    // sd of the clock times speed; or this share of the sensor's noise, whichever is more
  double motion_error_noise_ratio = 0.5;
  double jump_max_s = 0.004;            // of the clock within a stream
  double scale_max_ratio = 0.002;       // of the depth
  double contradiction_noise_ratio = 5.0;  // pairs of frames may disagree by so many sd of a reading
  int pairs_count = 120;                // pairs of frames that tell the clock
  double pair_time_s = 0.40;            // between the two of a pair
  int views_count_max = 16;             // a stream becomes at most so many captures of the cloud
  double cell_mm = 0;                   // readings are averaged in cells of this size; 0: one pixel at the working distance, at least 0.1
  int cells_count_max = 3000000;        // above, cells double
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("gap_max", s.gap_max_s), a("cut_max", s.cut_max_ratio), a("offset_max", s.offset_max_s), a("offset_quiet", s.offset_quiet_s);
    a("agree_sigma", s.agree_sigma_ratio), a("motion_error_max", s.motion_error_max_mm), a("motion_error_noise", s.motion_error_noise_ratio);
    a("jump_max", s.jump_max_s), a("scale_max", s.scale_max_ratio), a("contradiction", s.contradiction_noise_ratio), a("pairs", s.pairs_count);
    a("pair_time", s.pair_time_s), a("views_max", s.views_count_max), a("cell", s.cell_mm), a("cells_max", s.cells_count_max);
  }
};

/// A stream fused: captures as a standing sensor would have given them, one a view, points in that view's sensor frame.
struct FusedStream {
  struct View {
    Capture capture;                     // T_base_flange: the robot in the middle of the view
    double noise_mm = 0;                 // 1 sd of an averaged point at the working distance
  };
  std::vector<View> views;
  StreamSummary summary;
  double cell_mm = 0;
  std::size_t memory_bytes_count = 0;    // most that cells and frames took at a time
};

/// Clock    t_robot = t_sensor + offset, from flashes (intervals intersected) and from motion: for pairs of frames, the point-to-plane
///          equations of their relative motion against what the robot did between them, in offset and depth scale together; sd from the
///          scatter of the pairs (sandwich). With separate clocks and no flash the offset is first searched over the whole log.
/// Placing  SE(3) at the middle of the exposure. Frames in gaps wider than gap_max, or outside the log, are cut.
/// Fusing   integer sums a cell, so that neither the order of frames nor threads matter; cells are split by where the surface
///          faces, so that an edge is not averaged away.
/// Refuses  fuse.log_does_not_cover, fuse.log_gaps, fuse.flash_not_seen, fuse.clock_ambiguous, fuse.clock_not_seen,
///          fuse.clock_offset, fuse.clock_jump, fuse.clocks_disagree, fuse.depth_scale, fuse.stream_contradicts, and what `frames` refuses.
Result<Done<FusedStream>> fuse_stream(const StreamRecipe& recipe, const Capture& capture, const SensorSpec& sensor, const FrameSource& frames);

struct SurfaceRecipe {
  double voxel_mm = 1.0;
  double truncation_voxels_ratio = 4.0;  // or three sd of a reading, whichever is more
  int frames_count_min = 3;              // that must have seen a voxel
  std::size_t blocks_count_max = 60000;  // of 8 x 8 x 8 voxels: about 740 MB
};
/// The surface as a mesh and as points; for coverage, free space and pictures. No edge is ever taken from it.
struct FusedSurface {
  Mesh mesh_base;
  std::vector<Vec3> p_base;              // where the field crosses zero along a voxel's edge
  std::vector<Eigen::Vector3f> n_base;
  std::vector<float> sigma_mm;           // of the field there
  std::vector<int> frames_count;         // that saw it
  std::size_t blocks_count = 0, memory_bytes_count = 0;
};
/// Truncated signed distances (Curless and Levoy 1996), point to plane, integer sums: the same bytes for any order of frames and any
/// number of threads. `offset_s` as fuse_stream found it.
/// Refuses  fuse.surface_too_large, and what `frames` refuses.
Result<Done<FusedSurface>> fuse_surface(const SurfaceRecipe& recipe, const StreamRecipe& stream, const Capture& capture, const SensorSpec& sensor, double offset_s,
                                        const FrameSource& frames);

}  // namespace asbuilt
