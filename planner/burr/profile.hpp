// SPDX-License-Identifier: GPL-3.0-or-later
// Height along an edge from points that sample a thin fin here and there. The largest sample is no estimate: noise lifts it,
// sparse sampling lowers it. So the heights along the edge are a Markov chain, every point is one draw from [0, height] plus
// noise or an outlier, and the posterior (forward and backward over a grid of heights) gives mean, sd and upper bound.
#pragma once

#include <vector>

namespace asbuilt::burring {

struct HeightSample {
  double s_mm, height_mm, sigma_mm;
  double inlier_ratio;  // a priori, from how well it lies on the fin
};

struct ChainOptions {
  double threshold_mm = 0.03;     // samples below are not reported
  double height_max_mm = 4;       // end of the grid
  double outliers_mm2 = 3;        // stray samples per mm of height and mm of edge
  double dim_share = 0.05, dim_ratio = 0.12;  // stations where a fin is hit that much more rarely than foreseen
  double tip_mm = 0.007;          // width of the blunt tip that shows, with the scatter of its height
  double tip_scatter_mm = 0.012;
  double walk_mm = 0.03;          // sd of the change over 1 mm along the edge, for low burrs
  double walk_ratio = 0.05;       // and in addition, per mm of height
  double leave_ratio = 0.05;      // of mm along the edge without burr where one begins
  double jump_ratio = 0.006;      // of mm along the edge where the burr breaks off or starts
};

struct ChainPosterior {
  std::vector<double> mean_mm, sd_mm, upper_mm;  // upper: 97.5 %
  double log_evidence = 0;                       // of the samples under the options: which of two options describes them better
  std::vector<double> none_ratio;                // probability that nothing stands above the threshold
};

/// stations: ascending arc lengths. density: expected number of samples per mm^2 of fin at each station (0: unseen, nothing is
/// learnt from absence).
ChainPosterior height_profile(const ChainOptions& options, const std::vector<double>& stations_mm, const std::vector<HeightSample>& samples,
                              const std::vector<double>& density, bool is_closed);

}  // namespace asbuilt::burring
