// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/burr/section.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "planner/geom/polyline_index.hpp"

namespace asbuilt::burring {

namespace {

constexpr double kDoubts = 3;  // sd of a capture's unknown zero within which a point may stand out

/// Height over a face near the edge: the local plane of the station, bent as the fitted surface bends across the edge.
struct FaceFrame {
  bool is_plane = true;
  const Surface* surface = nullptr;
  SurfaceDomain domain;
  double outward = 1;
  std::vector<Vec2> uv;         // of the station's foot, from which other feet are sought
  std::vector<double> lift;     // of the station over the fitted surface
  std::vector<Vec3> n_surface;  // outward normal of the fitted surface at the station
};

FaceFrame frame_of(const SurfaceFit& fit, const std::vector<Vec3>& stations) {
  FaceFrame out;
  out.is_plane = std::holds_alternative<PlaneSurface>(fit.surface_part.shape);
  if (out.is_plane) return out;
  out.surface = &fit.surface_part;
  out.domain = asbuilt::domain(*out.surface);
  out.outward = fit.same_sense ? 1 : -1;
  for (const Vec3& p : stations) {
    const SurfaceFoot foot = project(*out.surface, out.domain, p, out.uv.empty() ? std::optional<Vec2>() : std::optional<Vec2>(out.uv.back()));
    out.uv.emplace_back(foot.u, foot.v);
    out.lift.push_back(out.outward * foot.signed_distance_mm);
    out.n_surface.push_back(out.outward * foot.n);
  }
  return out;
}

double height_over(const FaceFrame& frame, const Vec3& p, const Vec3& v, const Vec3& n, std::size_t i, double t) {
  if (frame.is_plane) return v.dot(n);
  const SurfaceFoot foot = project(*frame.surface, frame.domain, p, frame.uv[i]);
  const double lift = (1 - t) * frame.lift[i] + t * frame.lift[i + 1];
  const Vec3 n_surface = ((1 - t) * frame.n_surface[i] + t * frame.n_surface[i + 1]).normalized();
  return frame.outward * foot.signed_distance_mm - lift + v.dot(n - n_surface);
}

double median_of(std::vector<double> v) {
  if (v.empty()) return 0;
  std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
  return v[v.size() / 2];
}

/// How far one capture sees the two faces of one edge off the fitted ones, along the edge: medians over bins, smoothed over their
/// neighbours. Of a face that it does not see, nothing is known here.
class FaceZero {
 public:
  void collect(const SectionPoint& p) {
    const float out = p.out_mm(), inside = -std::min(p.f_1_mm, p.f_2_mm);
    if (std::abs(out) > kMost_mm || inside < 0.4 || inside > 2.5 || p.s_mm < 0) return;
    auto& side = heights_[p.f_1_mm > p.f_2_mm ? 0 : 1];
    const std::size_t bin = static_cast<std::size_t>(p.s_mm / kBin_mm);
    if (side.size() <= bin) side.resize(bin + 1);
    side[bin].push_back(out);
  }
  void settle() {
    for (std::size_t k = 0; k < 2; ++k) {
      auto& side = heights_[k];
      std::vector<std::pair<double, double>> middles;  // of a bin: weight, median
      for (auto& bin : side) {
        middles.emplace_back(bin.size() < kPointsMin ? 0.0 : static_cast<double>(std::min<std::size_t>(bin.size(), 40)), 0.0);
        if (bin.size() < kPointsMin) continue;
        std::nth_element(bin.begin(), bin.begin() + static_cast<std::ptrdiff_t>(bin.size() / 2), bin.end());
        middles.back().second = bin[bin.size() / 2];
      }
      for (std::size_t i = 0; i < middles.size(); ++i) {
        double sum = 0, weight = 0;
        for (std::size_t j = i > 0 ? i - 1 : 0; j <= std::min(i + 1, middles.size() - 1); ++j)
          sum += middles[j].first * middles[j].second, weight += middles[j].first;
        zero_[k].push_back(weight > 0 ? sum / weight : kUnknown);
      }
      for (std::size_t i = 1; i < zero_[k].size(); ++i)  // over gaps the one before holds, then the one behind
        if (zero_[k][i] == kUnknown) zero_[k][i] = zero_[k][i - 1];
      for (std::size_t i = zero_[k].size(); i-- > 1;)
        if (zero_[k][i - 1] == kUnknown) zero_[k][i - 1] = zero_[k][i];
      side.clear();
    }
  }
  bool is_known(std::size_t side) const { return !zero_[side].empty() && zero_[side].front() != kUnknown; }
  double at(std::size_t side, double s_mm) const {
    if (!is_known(side)) return 0;
    const auto& zero = zero_[side];
    const double x = std::clamp(s_mm / kBin_mm - 0.5, 0.0, static_cast<double>(zero.size() - 1));
    const std::size_t i = std::min(static_cast<std::size_t>(x), zero.size() - 1), j = std::min(i + 1, zero.size() - 1);
    return zero[i] + (x - static_cast<double>(i)) * (zero[j] - zero[i]);
  }

 private:
  static constexpr double kBin_mm = 4.0, kMost_mm = 0.2, kUnknown = 1e9;
  static constexpr std::size_t kPointsMin = 8;
  std::array<std::vector<std::vector<float>>, 2> heights_;
  std::array<std::vector<double>, 2> zero_;
};

}  // namespace

Carving::Carving() {
  for (auto& l : lowest_mm) l.fill(std::numeric_limits<float>::infinity());
}
void Carving::add(int lean, float at_mm) {
  auto& l = lowest_mm[static_cast<std::size_t>(lean)];
  if (at_mm < l[0]) l[1] = l[0], l[0] = at_mm;
  else if (at_mm < l[1]) l[1] = at_mm;
}

double carved_height_mm(const EdgeSection& section, double s_mm, double lean_rad, double window_mm) {
  if (section.carved.empty()) return std::numeric_limits<double>::infinity();
  const int count = static_cast<int>(section.carved.size());
  const int from = std::clamp(static_cast<int>((s_mm - window_mm) / Carving::kBin_mm), 0, count - 1);
  const int to = std::clamp(static_cast<int>((s_mm + window_mm) / Carving::kBin_mm), 0, count - 1);
  double tallest = 0;
  for (int k = 0; k < Carving::kLeans; ++k) {
    if (std::isfinite(lean_rad) && std::abs(Carving::lean_rad(k) - lean_rad) > rad_from_deg(16)) continue;
    Carving all;
    for (int b = from; b <= to; ++b)
      for (const float at : section.carved[static_cast<std::size_t>(b)].lowest_mm[static_cast<std::size_t>(k)]) all.add(k, at);
    tallest = std::max(tallest, static_cast<double>(all.lowest_mm[static_cast<std::size_t>(k)][1]));
  }
  return tallest;
}

namespace {

/// Where the ray from the eye to a point in section coordinates (f_1, f_2, s) crosses the half-lines on which a fin could stand.
/// `doubt_mm`: of the point's heights over the two faces; a bound is raised by it.
void carve(std::vector<Carving>& carved, double f_1, double f_2, double s, const Vec3& to_eye, double margin_mm,
           const std::array<double, 2>& doubt_mm) {
  for (int k = 0; k < Carving::kLeans; ++k) {
    const double c = std::cos(Carving::lean_rad(k)), w = std::sin(Carving::lean_rad(k));
    const double facing = to_eye.x() * w - to_eye.y() * c;
    if (std::abs(facing) < 0.15) continue;  // along the fin: it would hide nothing
    const double t = -(f_1 * w - f_2 * c) / facing;
    if (t < margin_mm) continue;
    const double along = (f_1 + t * to_eye.x()) * c + (f_2 + t * to_eye.y()) * w;
    const double at_s = s + t * to_eye.z();
    if (along <= 0 || at_s < 0) continue;
    const std::size_t bin = static_cast<std::size_t>(at_s / Carving::kBin_mm);
    if (bin < carved.size()) carved[bin].add(k, static_cast<float>(along * std::max(c, w) + 2 * (c > w ? doubt_mm[0] : doubt_mm[1])));
  }
}

/// 1 sd of a capture's place along the two normals of an edge, at its middle.
std::array<double, 2> doubt_mm(const Location& location, const AdaptedEdge& edge, std::size_t capture) {
  if (capture >= location.corrections.size() || capture >= location.correction_covariances.size() || edge.adapted.empty()) return {0, 0};
  const std::size_t i = edge.adapted.size() / 2;
  const auto& correction = location.corrections[capture];
  const Vec3 p = correction.inverse().point(location.T_base_part.point(edge.adapted[i]));
  Eigen::Matrix<double, 3, 6> g;
  g << correction.rotation(), -correction.rotation() * skew(p);
  const Mat3 covariance = g * location.correction_covariances[capture] * g.transpose();
  const auto along = [&](const Vec3& n_part) {
    const Vec3 n = location.T_base_part.direction(n_part);
    return std::sqrt(std::max(0.0, n.dot(covariance * n)));
  };
  return {along(edge.n_1[i]), along(edge.n_2[i])};
}

}  // namespace

std::vector<EdgeSection> cut_sections(const SectionOptions& options, const MeasuredCloud& cloud, const Location& location,
                                      const Features& features, const std::vector<char>& use) {
  std::vector<std::vector<Vec3>> lines;
  std::vector<FaceFrame> frames_1, frames_2;
  for (const AdaptedEdge& e : features.edges) {
    lines.push_back(e.adapted);
    frames_1.push_back(frame_of(e.surface_1, e.adapted)), frames_2.push_back(frame_of(e.surface_2, e.adapted));
  }
  const PolylineIndex index(lines, options.reach_mm);
  const Pose<frame::Part, frame::Base> T_part_base = location.T_base_part.inverse();

  struct Found {
    int edge = -1;
    int kind = 0;            // 0 proud, 1 / 2 on a face
    float distance_mm = 0;   // from the edge
    SectionPoint point;
  };
  std::vector<Found> found(cloud.p_base.size());
  std::vector<EdgeSection> out(features.edges.size());
  for (std::size_t e = 0; e < out.size(); ++e) out[e].carved.resize(static_cast<std::size_t>(features.edges[e].s_mm.back() / Carving::kBin_mm) + 1);
  for (std::size_t k = 0; k < cloud.captures.size(); ++k) {
    if (!use[k]) continue;
    const auto correction = k < features.corrections.size() ? features.corrections[k] : Pose<frame::Base, frame::Base>{};
    const auto T = T_part_base * correction;
    const Mat3 rotation = T.rotation();
    const Vec3 eye = T.point(cloud.captures[k].T_base_sensor.p_mm);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(cloud.captures[k].begin, cloud.captures[k].end, 2048),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                        std::vector<PolylineFoot> near;
                        for (std::size_t i = range.begin(); i < range.end(); ++i) {
                          const Vec3 p = rotation * cloud.p_base[i] + T.p_mm;
                          index.near(p, near);
                          const PolylineFoot* best = nullptr;  // the nearest edge has the point
                          for (const PolylineFoot& f : near)
                            if (!f.is_beyond && (!best || f.distance_mm < best->distance_mm)) best = &f;
                          if (!best) continue;
                          const AdaptedEdge& e = features.edges[best->line];
                          const std::size_t a = static_cast<std::size_t>(best->segment);
                          const Vec3 v = p - best->p;
                          const Vec3 n_1 = ((1 - best->t) * e.n_1[a] + best->t * e.n_1[a + 1]).normalized();
                          const Vec3 n_2 = ((1 - best->t) * e.n_2[a] + best->t * e.n_2[a + 1]).normalized();
                          const double f_1 = height_over(frames_1[best->line], p, v, n_1, a, best->t);
                          const double f_2 = height_over(frames_2[best->line], p, v, n_2, a, best->t);
                          Found& f = found[i];
                          const Vec3 ray = (p - eye).normalized();
                          f.edge = best->line, f.distance_mm = static_cast<float>(v.norm());
                          f.point = {static_cast<float>(best->s_mm), static_cast<float>(f_1), static_cast<float>(f_2),
                                     std::max(1e-4f, cloud.sigma_mm[i]), static_cast<float>(ray.dot(n_1)), static_cast<float>(ray.dot(n_2)),
                                     static_cast<int>(k)};
                        }
                      });
  }

  // Each capture's own faces beside the edge are its zero: what is left between captures, and between them and the fit, is no burr.
  std::vector<std::vector<FaceZero>> zeros(cloud.captures.size(), std::vector<FaceZero>(out.size()));
  for (const Found& f : found)
    if (f.edge >= 0) zeros[static_cast<std::size_t>(f.point.capture)][static_cast<std::size_t>(f.edge)].collect(f.point);
  tbb::parallel_for(std::size_t(0), cloud.captures.size(), [&](std::size_t k) {
    for (FaceZero& zero : zeros[k]) zero.settle();
  });
  for (std::size_t e = 0; e < out.size(); ++e)
    for (std::size_t k = 0; k < cloud.captures.size(); ++k) {
      auto sd = doubt_mm(location, features.edges[e], k);
      for (std::size_t side = 0; side < 2; ++side)
        if (zeros[k][e].is_known(side)) sd[side] = 0;
      out[e].zero_sd_mm.push_back(sd);
    }
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, found.size(), 4096), [&](const tbb::blocked_range<std::size_t>& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      Found& f = found[i];
      if (f.edge < 0) continue;
      const FaceZero& zero = zeros[static_cast<std::size_t>(f.point.capture)][static_cast<std::size_t>(f.edge)];
      f.point.f_1_mm -= static_cast<float>(zero.at(0, f.point.s_mm)), f.point.f_2_mm -= static_cast<float>(zero.at(1, f.point.s_mm));
      const float f_1 = f.point.f_1_mm, f_2 = f.point.f_2_mm;
      const double height = std::max(f_1, f_2);
      const auto& doubt = out[static_cast<std::size_t>(f.edge)].zero_sd_mm[static_cast<std::size_t>(f.point.capture)];
      bool is_kept = false;
      if (height > options.threshold_mm) {
        // A burr stands on the edge: what hangs over a face farther off than it stands out is no burr.
        is_kept = f.distance_mm <= 1.45 * height + 0.25;
        f.kind = 0;
      } else {
        const double inside = -std::min(f_1, f_2);
        is_kept = std::abs(height) <= options.threshold_mm && inside >= 0.25 && inside <= 2.5;
        f.kind = f_1 > f_2 ? 1 : 2;
        if (!is_kept && std::max(f_1 + kDoubts * doubt[0], f_2 + kDoubts * doubt[1]) > options.threshold_mm && f.distance_mm <= 0.25)
          is_kept = true, f.kind = 0;
      }
      if (!is_kept) f.edge = -1;
    }
  });
  std::vector<std::vector<double>> heights_1(out.size()), heights_2(out.size());
  for (EdgeSection& section : out) section.sights.resize(cloud.captures.size());
  // Rays, capture by capture: each fills its own bins, which are merged in their order.
  std::vector<std::vector<std::vector<Carving>>> by_capture(cloud.captures.size());
  tbb::parallel_for(std::size_t(0), cloud.captures.size(), [&](std::size_t k) {
    if (!use[k]) return;
    auto& mine = by_capture[k];
    mine.resize(out.size());
    const auto T = T_part_base * (k < features.corrections.size() ? features.corrections[k] : Pose<frame::Base, frame::Base>{});
    const Mat3 rotation = T.rotation();
    const Vec3 eye = T.point(cloud.captures[k].T_base_sensor.p_mm);
    std::vector<PolylineFoot> near;
    for (std::size_t i = cloud.captures[k].begin; i < cloud.captures[k].end; ++i) {
      const Vec3 p = rotation * cloud.p_base[i] + T.p_mm;
      index.near(p, near);
      for (const PolylineFoot& f : near) {
        if (f.is_beyond) continue;
        const AdaptedEdge& e = features.edges[f.line];
        const std::size_t a = static_cast<std::size_t>(f.segment);
        const Vec3 v = p - f.p, ray = (eye - p).normalized(), tangent = (e.adapted[a + 1] - e.adapted[a]).normalized();
        auto& bins = mine[f.line];
        if (bins.empty()) bins.resize(out[f.line].carved.size());
        const FaceZero& zero = zeros[k][f.line];
        carve(bins, v.dot(e.n_1[a]) - zero.at(0, f.s_mm), v.dot(e.n_2[a]) - zero.at(1, f.s_mm), f.s_mm, Vec3(ray.dot(e.n_1[a]), ray.dot(e.n_2[a]), ray.dot(tangent)), 0.05,
              out[f.line].zero_sd_mm[k]);
      }
    }
  });
  for (const auto& mine : by_capture)
    for (std::size_t e = 0; e < mine.size(); ++e)
      for (std::size_t b = 0; b < mine[e].size(); ++b)
        for (int k = 0; k < Carving::kLeans; ++k)
          for (const float at : mine[e][b].lowest_mm[static_cast<std::size_t>(k)]) out[e].carved[b].add(k, at);

  for (const Found& f : found) {
    if (f.edge < 0) continue;
    EdgeSection& section = out[f.edge];
    if (f.kind == 0) {
      section.proud.push_back(f.point);
    } else {
      (f.kind == 1 ? section.face_1_s : section.face_2_s).push_back(f.point.s_mm);
      auto& sights = section.sights[static_cast<std::size_t>(f.point.capture)];
      if (sights.empty()) sights.resize(std::max<std::size_t>(1, static_cast<std::size_t>(features.edges[f.edge].s_mm.back())));
      Sight& sight = sights[std::min(sights.size() - 1, static_cast<std::size_t>(f.point.s_mm))];
      ++(f.kind == 1 ? sight.points_1_count : sight.points_2_count);
      sight.ray_1 += f.point.ray_1, sight.ray_2 += f.point.ray_2;
      (f.kind == 1 ? heights_1 : heights_2)[f.edge].push_back(f.kind == 1 ? f.point.f_1_mm : f.point.f_2_mm);
    }
  }
  for (EdgeSection& section : out)
    for (auto& sights : section.sights)
      for (Sight& sight : sights)
        if (const int n = sight.points_1_count + sight.points_2_count; n > 0)
          sight.ray_1 /= static_cast<float>(n), sight.ray_2 /= static_cast<float>(n);
  for (std::size_t e = 0; e < out.size(); ++e) {
    std::sort(out[e].face_1_s.begin(), out[e].face_1_s.end()), std::sort(out[e].face_2_s.begin(), out[e].face_2_s.end());
    out[e].offset_1_mm = median_of(heights_1[e]), out[e].offset_2_mm = median_of(heights_2[e]);
    std::vector<double> spread;
    for (const double h : heights_1[e]) spread.push_back(std::abs(h - out[e].offset_1_mm));
    for (const double h : heights_2[e]) spread.push_back(std::abs(h - out[e].offset_2_mm));
    out[e].noise_mm = 1.4826 * median_of(std::move(spread));
  }
  return out;
}

}  // namespace asbuilt::burring
