// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/path/gate.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/result.hpp"

namespace asbuilt {

namespace {
double normal_cdf(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }
}  // namespace

GateTerms gate_terms(const Job& job, const ToolSpec& tool, const Mat3& R_part_tool, double path_tolerance_mm) {
  GateTerms t;
  t.tool = R_part_tool * tool.covariance.topLeftCorner<3, 3>() * R_part_tool.transpose();
  const MeanSd& s = job.cell.robot.accuracy.short_term;
  // mean and sd of the length of an offset vector: the sum of three equal axis variances is mean^2 + sd^2
  t.scatter_mm = std::sqrt((s.mean_mm * s.mean_mm + s.sd_mm * s.sd_mm) / 3);
  t.interpolation_mm = path_tolerance_mm;
  return t;
}

double leg_probability(const CutterPlacement& at, const Mat3& covariance, double width, double tolerance) {
  const double low_1 = width - tolerance - at.leg_1_mm, high_1 = width + tolerance - at.leg_1_mm;
  const double low_2 = width - tolerance - at.leg_2_mm, high_2 = width + tolerance - at.leg_2_mm;
  const double v_1 = at.slope_1.dot(covariance * at.slope_1), v_2 = at.slope_2.dot(covariance * at.slope_2);
  const double c = at.slope_1.dot(covariance * at.slope_2);
  const auto inside = [](double low, double high) { return low <= 0 && high >= 0 ? 1.0 : 0.0; };
  if (v_1 < 1e-14 && v_2 < 1e-14) return inside(low_1, high_1) * inside(low_2, high_2);
  // x: leg 1 in units of its sd; leg 2 given x is normal about g x with sd r
  const double s_1 = std::sqrt(std::max(v_1, 1e-16)), g = c / s_1, r = std::sqrt(std::max(v_2 - g * g, 0.0));
  if (r < 1e-4 * std::sqrt(std::max(v_2, 1e-16))) {  // one error decides both legs
    double low = low_1 / s_1, high = high_1 / s_1;
    if (std::abs(g) > 1e-9) {
      const double a = low_2 / g, b = high_2 / g;
      low = std::max(low, std::min(a, b)), high = std::min(high, std::max(a, b));
    } else if (inside(low_2, high_2) == 0) {
      return 0;
    }
    return high > low ? normal_cdf(high) - normal_cdf(low) : 0.0;
  }
  const double a = std::max(low_1 / s_1, -8.0), b = std::min(high_1 / s_1, 8.0);
  if (b <= a) return 0;
  constexpr int kSteps = 200;  // Simpson
  const double h = (b - a) / kSteps;
  double sum = 0;
  for (int i = 0; i <= kSteps; ++i) {
    const double x = a + i * h;
    const double f = std::exp(-0.5 * x * x) / std::sqrt(2 * kPi) * (normal_cdf((high_2 - g * x) / r) - normal_cdf((low_2 - g * x) / r));
    sum += f * (i == 0 || i == kSteps ? 1 : i % 2 ? 4 : 2);
  }
  return std::clamp(sum * h / 3, 0.0, 1.0);
}

double gouge_probability(const CutterPlacement& at, const Mat3& covariance, double width, double tolerance, double damage) {
  const double sd = std::sqrt(std::max(at.m.dot(covariance * at.m), 1e-16));
  // along the chamfer's normal a leg error of 1 is a depth error of 1 / slope
  const double slope = std::max(at.slope_1.dot(at.m), at.slope_2.dot(at.m));
  const double deepest = std::max(at.leg_1_mm, at.leg_2_mm);
  const double room = (width + tolerance - deepest) / std::max(slope, 1e-6) + damage;
  return 1 - normal_cdf(room / sd);
}

GateResult judge_edge(const AdaptedEdge& edge, const std::vector<CutterPlacement>& at, const Recipe& recipe, const GateTerms& terms, double damage) {
  const std::size_t n = at.size();
  must(edge.covariance.size() == n && edge.s_mm.size() == n, "edge arrays are not parallel");
  GateResult g;
  g.probability_ratio.resize(n);
  const double interpolation = terms.interpolation_mm * terms.interpolation_mm / 3;  // uniform
  const double scatter = terms.scatter_mm * terms.scatter_mm;
  must(terms.posture.empty() || terms.posture.size() == n, "posture covariances are not parallel");
  double length = 0, within = 0, v_edge = 0, v_tool = 0, v_posture = 0;
  g.whole_ratio = 1;
  for (std::size_t i = 0; i < n; ++i) {
    const Mat3 posture = terms.posture.empty() ? Mat3(Mat3::Zero()) : terms.posture[i];
    const Mat3 total = edge.covariance[i] + posture + (scatter + interpolation) * Mat3::Identity();  // the tool's part is the edge's already
    const double p = leg_probability(at[i], total, recipe.width_mm, recipe.tolerance_mm);
    g.probability_ratio[i] = p;
    if (p < g.whole_ratio) g.whole_ratio = p, g.worst_station = i;
    g.gouge_worst_ratio = std::max(g.gouge_worst_ratio, gouge_probability(at[i], total, recipe.width_mm, recipe.tolerance_mm, damage));
    const double before = i > 0 ? edge.s_mm[i] - edge.s_mm[i - 1] : 0, after = i + 1 < n ? edge.s_mm[i + 1] - edge.s_mm[i] : 0;
    const double weight = 0.5 * (before + after);
    length += weight, within += weight * p, v_posture += weight * at[i].m.dot(posture * at[i].m);
    g.bias_mm = std::max({g.bias_mm, std::abs(at[i].leg_1_mm - recipe.width_mm), std::abs(at[i].leg_2_mm - recipe.width_mm)});
    v_edge += weight * at[i].m.dot(edge.covariance[i] * at[i].m), v_tool += weight * at[i].m.dot(terms.tool * at[i].m);
  }
  if (length > 0) {
    g.share_ratio = within / length;
    v_edge /= length, v_tool /= length, v_posture /= length;
    v_edge = std::max(0.0, v_edge - v_tool);
    const double total = v_edge + v_tool + v_posture + scatter + interpolation;
    g.sd_mm = std::sqrt(total);
    if (total > 0)
      g.share_edge = v_edge / total, g.share_tool = v_tool / total, g.share_posture = v_posture / total, g.share_scatter = scatter / total,
      g.share_interpolation = interpolation / total;
  }
  return g;
}

const Override* override_for(const Job& job, const std::string& edge_id) {
  for (const Override& o : job.overrides)
    if (o.edge == edge_id && !job.taken.empty() && !o.expires.empty() && job.taken <= o.expires) return &o;  // ISO dates compare as text
  return nullptr;
}

}  // namespace asbuilt
