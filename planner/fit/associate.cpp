// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fit/associate.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <tuple>

namespace asbuilt::fitting {

namespace {

struct Member {
  int slot = -1, capture, edge;
  std::uint32_t point;
  std::int64_t voxel;
  float s_mm, inside_mm;
};

double median_of(std::vector<double>& v) {
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

}  // namespace

std::vector<Cell> associate(const Association& how, const MeasuredCloud& cloud, const Pose<frame::Base, frame::Part>& T_base_part,
                            const std::vector<Pose<frame::Base, frame::Base>>& corrections, const std::vector<char>& is_fine,
                            const std::vector<char>& coarse_edges, const std::vector<EdgeModel>& edges,
                            const std::vector<FaceModel>& faces, const PolylineIndex& all_edges, const std::vector<int>& all_edges_index) {
  std::vector<std::vector<Vec3>> lines;
  for (const EdgeModel& e : edges) lines.push_back(e.current);
  const PolylineIndex worked(lines, how.reach_mm * 1.05);
  // Edges with a face that is taken from farther in have an index of their own: a long reach is dear.
  const bool any_far = !how.is_far.empty();
  for (std::size_t e = 0; e < edges.size(); ++e)
    if (how.reach_of(edges[e].slot_1) <= how.reach_mm && how.reach_of(edges[e].slot_2) <= how.reach_mm) lines[e].clear();
  const PolylineIndex far = any_far ? PolylineIndex(lines, how.reach_most() * 1.05) : PolylineIndex();
  const Pose<frame::Part, frame::Base> T_part_base = T_base_part.inverse();

  const bool any_coarse = std::find(coarse_edges.begin(), coarse_edges.end(), 1) != coarse_edges.end();
  std::vector<Member> members(cloud.p_base.size());
  std::vector<Vec3> p_part(cloud.p_base.size());
  for (std::size_t k = 0; k < cloud.captures.size(); ++k) {
    if (!is_fine[k] && !any_coarse) continue;
    const Pose<frame::Part, frame::Base> T = T_part_base * corrections[k];
    const Mat3 rotation = T.rotation();
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(cloud.captures[k].begin, cloud.captures[k].end, 2048),
        [&](const tbb::blocked_range<std::size_t>& range) {
          std::vector<PolylineFoot> near_worked, near_far, near_any;
          for (std::size_t i = range.begin(); i < range.end(); ++i) {
            const Vec3 p = rotation * cloud.p_base[i] + T.p_mm;
            worked.near(p, near_worked);
            if (any_far) {
              far.near(p, near_far);
              for (const PolylineFoot& foot : near_far)
                if (foot.distance_mm > how.reach_mm * 1.05) near_worked.push_back(foot);
            }
            if (near_worked.empty()) continue;
            const Vec3 n_measured = rotation * cloud.n_base[i].cast<double>();
            const bool has_normal = n_measured.squaredNorm() > 0.25;
            Member best;
            double best_score = 1e300;
            for (const PolylineFoot& foot : near_worked) {
              const EdgeModel& edge = edges[foot.line];
              if (foot.is_beyond || (!is_fine[k] && !coarse_edges[static_cast<std::size_t>(foot.line)])) continue;
              const Vec3 v = p - foot.p;
              const Vec3 tangent = edge.tangent[foot.segment];
              for (const int slot : {edge.slot_1, edge.slot_2}) {
                const FaceModel& face = faces[slot];
                const FaceModel& other = faces[slot == edge.slot_1 ? edge.slot_2 : edge.slot_1];
                Vec3 n, n_other;
                const double d = face_distance(face, p, n);
                if (std::abs(d) > how.gate_mm) continue;
                if (has_normal && n_measured.dot(n) * face.outward() < 0.87) continue;
                surface_distance(other, foot.p, n_other);
                Vec3 into = n.cross(tangent);
                const double side = into.dot(n_other) * other.outward();
                if ((side > 0) == edge.is_convex) into = -into;
                const double inside = v.dot(into.normalized());
                if (inside < how.from_mm || inside > how.reach_of(slot) || std::abs(d) > 0.7 * inside) continue;
                const double score = std::abs(d) + 0.02 * inside;
                if (score < best_score) {
                  best_score = score;
                  best.slot = slot, best.edge = foot.line;
                  best.s_mm = static_cast<float>(foot.s_mm), best.inside_mm = static_cast<float>(inside);
                }
              }
            }
            if (best.slot < 0) continue;
            all_edges.near(p, near_any);
            bool is_clear = true;
            for (const PolylineFoot& foot : near_any) {
              const int edge = all_edges_index[foot.line];
              const bool is_own = edge == edges[best.edge].edge;
              if (!is_own && foot.distance_mm < how.other_edges_mm) is_clear = false;
            }
            for (const PolylineFoot& foot : near_worked)
              if (foot.distance_mm < how.from_mm) is_clear = false;
            if (!is_clear) continue;
            best.capture = static_cast<int>(k);
            best.point = static_cast<std::uint32_t>(i);
            const Eigen::Array3d c = (p / how.cell_mm).array().floor() + 1048576.0;
            best.voxel = (static_cast<std::int64_t>(c.x()) << 42) | (static_cast<std::int64_t>(c.y()) << 21) |
                         static_cast<std::int64_t>(c.z());
            members[i] = best;
            p_part[i] = p;
          }
        });
  }
  std::erase_if(members, [](const Member& m) { return m.slot < 0; });
  std::sort(members.begin(), members.end(), [](const Member& a, const Member& b) {
    return std::tie(a.slot, a.capture, a.voxel, a.point) < std::tie(b.slot, b.capture, b.voxel, b.point);
  });

  std::vector<Cell> cells;
  std::vector<double> d, work;
  for (std::size_t a = 0, b = 0; a < members.size(); a = b) {
    while (b < members.size() && members[b].slot == members[a].slot && members[b].capture == members[a].capture &&
           members[b].voxel == members[a].voxel)
      ++b;
    const FaceModel& face = faces[members[a].slot];
    d.clear();
    for (std::size_t i = a; i < b; ++i) {
      Vec3 n;
      d.push_back(face_distance(face, p_part[members[i].point], n));
    }
    work = d;
    const double middle = median_of(work);
    for (double& w : work) w = std::abs(w - middle);
    const double sigma = std::max(1e-4, static_cast<double>(cloud.sigma_mm[members[a].point]));
    const double scale = std::max(sigma, 1.4826 * median_of(work));
    double weight = 0, mean_d = 0, s = 0, inside = 0, square = 0;
    Vec3 mean = Vec3::Zero();
    for (std::size_t i = a; i < b; ++i) {
      const double u = (d[i - a] - middle) / (4.685 * scale);
      if (std::abs(u) >= 1) continue;
      const double w = (1 - u * u) * (1 - u * u);
      weight += w, mean_d += w * d[i - a], mean += w * p_part[members[i].point];
      s += w * members[i].s_mm, inside += w * members[i].inside_mm, square += w * (d[i - a] - middle) * (d[i - a] - middle);
    }
    if (weight < 2) continue;
    mean_d /= weight, mean /= weight;
    Vec3 n;
    const double off = face_distance(face, mean, n);
    const Vec3 on = mean + (mean_d - off) * n;  // on a curved face the mean of points is not at their mean height
    Cell cell;
    cell.slot = members[a].slot, cell.capture = members[a].capture, cell.edge = members[a].edge;
    cell.p_base = corrections[cell.capture].inverse().point(T_base_part.point(on));
    cell.s_mm = s / weight, cell.inside_mm = inside / weight;
    cell.points_count = static_cast<int>(b - a);
    cell.scatter_mm = std::sqrt(square / weight);
    // Neighbouring points share their error (about six to one), and a cell as a whole keeps some of it.
    cell.sd_mm = std::sqrt(scale * scale * std::min(1.0, 6.0 / weight) + 0.0015 * 0.0015);
    cells.push_back(cell);
  }
  return cells;
}

}  // namespace asbuilt::fitting
