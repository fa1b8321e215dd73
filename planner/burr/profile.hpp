// SPDX-License-Identifier: GPL-3.0-or-later
// Height along an edge from points that sample a thin fin here and there. The largest sample is no estimate: noise lifts it,
// sparse sampling lowers it. So the heights along the edge are a Markov chain, every point is one draw from [0, height] plus
// noise or an outlier, and the posterior (forward and backward over a grid of heights) gives mean, sd and upper bound.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace asbuilt::burring {

struct HeightSample {
  double s_mm, height_mm, sigma_mm;
  double inlier_ratio;  // a priori, from how well it lies on the fin
};

struct ChainOptions {
  double threshold_mm = 0.03;     // samples below are not reported
  double height_max_mm = 4;       // end of the grid
  double outliers_mm2 = 3;        // stray samples per mm of height and mm of edge, at most;
  double outliers_ratio = 0.05;   // else this share of the samples that a fin would get
  double dim_share = 0.05, dim_ratio = 0.12;  // of the edge where a fin is hit that much more rarely than foreseen
  double dim_length_mm = 8;       // and over which length it stays so
  double crest_ratio = 0;         // how much more densely the fin is hit at its crest (a thick fin's tapered end faces the views) ..
  double crest_mm = 0.04;         // .. falling off over this depth below it
  double tip_mm = 0.007;          // width of the blunt tip that shows, with the scatter of its height
  double tip_scatter_mm = 0.012;
  double walk_mm = 0.03;          // sd of the change over 1 mm along the edge, for low burrs
  double walk_ratio = 0.05;       // and in addition, per mm of height
  double leave_ratio = 0.05;      // of mm along the edge without burr where one begins
  double jump_ratio = 0.006;      // of mm along the edge where the burr breaks off or starts
};

struct ChainPosterior {
  std::vector<double> mean_mm, median_mm, sd_mm, upper_mm;  // upper: 97.5 %
  double log_evidence = 0;                       // of the samples under the options: which of two options describes them better
  std::vector<double> none_ratio;                // probability that nothing stands above the threshold
};

/// log of how likely the samples at each station (columns) are, for each height of the grid (rows), where a fin is hit as foreseen or
/// (dim) more rarely.
struct Emission {
  Eigen::MatrixXd clear, dim;
};
std::vector<double> height_grid(double height_max_mm);
Emission emission_of(const ChainOptions& options, const std::vector<double>& grid, const std::vector<double>& stations_mm,
                     const std::vector<HeightSample>& samples, const std::vector<double>& density);

/// What a fin of height h exposes to be hit, per mm of edge: its height above the threshold, its blunt tip and what its crest adds.
double exposed_mm(const ChainOptions& options, double height_mm);

/// log of how likely the whole emission is: the forward pass alone.
double log_evidence(const ChainOptions& options, const std::vector<double>& grid, const std::vector<double>& stations_mm, const Emission& emission,
                    bool is_closed, const std::vector<double>& dim_share);

/// stations: ascending arc lengths. dim_share: by station, instead of the options'; may be empty. density: expected number of samples per mm^2 of fin at each station (0: unseen, nothing is
/// learnt from absence).
ChainPosterior height_profile(const ChainOptions& options, const std::vector<double>& stations_mm, const std::vector<HeightSample>& samples,
                              const std::vector<double>& density, bool is_closed, const std::vector<double>& dim_share = {});

}  // namespace asbuilt::burring
