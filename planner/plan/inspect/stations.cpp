// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/inspect/stations.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace asbuilt::inspecting {

namespace {

constexpr int kStrips = 4;
constexpr double kAbove_mm = 0.6, kBelow_mm = 1.2;  // where the face is looked for, from the tangent plane at the edge
const double kSameFace_cos = std::cos(rad_from_deg(35));

/// "#9" before "#10": by length, then by letters.
std::tuple<std::size_t, std::string> id_order(const std::string& id) { return {id.size(), id}; }

Station station_at(const BrepEdge& e, double s) {
  std::size_t k = 1;
  while (k + 1 < e.s_mm.size() && e.s_mm[k] < s) ++k;
  const double span = e.s_mm[k] - e.s_mm[k - 1], t = span > 0 ? std::clamp((s - e.s_mm[k - 1]) / span, 0.0, 1.0) : 0.0;
  const auto between = [&](const std::vector<Vec3>& v) { return Vec3((1 - t) * v[k - 1] + t * v[k]); };
  Station out;
  out.s_mm = s, out.p = between(e.p), out.tangent = between(e.tangent).normalized();
  out.n = {between(e.n_1).normalized(), between(e.n_2).normalized()};
  out.into = {out.n[0].cross(out.tangent).normalized(), out.tangent.cross(out.n[1]).normalized()};
  return out;
}

void add_patches(Station& s, const RayTree& part, const Mesh& mesh, double station_mm) {
  const double width = (kBandTo_mm - kBandFrom_mm) / kStrips;
  for (std::size_t f = 0; f < 2; ++f)
    for (int k = 0; k < kStrips; ++k) {
      const double offset = kBandFrom_mm + (k + 0.5) * width;
      const Vec3 above = s.p + offset * s.into[f] + kAbove_mm * s.n[f];
      const auto hit = part.first_hit(above, -s.n[f], 0, kAbove_mm + kBelow_mm);
      if (!hit) continue;
      const Vec3 n = mesh.triangle_normal(hit->triangle);
      if (n.dot(s.n[f]) < kSameFace_cos) continue;
      s.patches[f].push_back({above - hit->distance_mm * s.n[f], n, width * station_mm, offset});
    }
}

}  // namespace

std::vector<EdgeStations> stations_of(const Job& job, const Location& location, double station_mm) {
  const Brep& brep = job.part.brep;
  const RayTree part(brep.mesh);
  std::vector<EdgeStations> out;
  for (const FeatureSpec& feature : job.part.features)
    for (const int i : feature.edges) {
      const BrepEdge& e = brep.edges[static_cast<std::size_t>(i)];
      EdgeStations es;
      es.edge = i, es.id = e.id, es.feature = feature.id, es.recipe = job.recipe(feature.recipe);
      const double length = e.s_mm.empty() ? 0 : e.s_mm.back();
      const int n = std::max(1, static_cast<int>(std::round(length / station_mm)));
      if (e.s_mm.size() >= 2 && e.n_1.size() == e.p.size() && e.n_2.size() == e.p.size())
        for (int k = 0; k < n; ++k) {
          Station s = station_at(e, (k + 0.5) * length / n);
          add_patches(s, part, brep.mesh, length / n);
          for (auto& patches : s.patches)
            for (Patch& p : patches) p.p = location.T_base_part.point(p.p), p.n = location.T_base_part.direction(p.n);
          s.p = location.T_base_part.point(s.p), s.tangent = location.T_base_part.direction(s.tangent);
          for (std::size_t f = 0; f < 2; ++f)
            s.n[f] = location.T_base_part.direction(s.n[f]), s.into[f] = location.T_base_part.direction(s.into[f]);
          es.stations.push_back(std::move(s));
        }
      out.push_back(std::move(es));
    }
  std::stable_sort(out.begin(), out.end(), [](const EdgeStations& a, const EdgeStations& b) {
    return std::tuple(a.feature, id_order(a.id)) < std::tuple(b.feature, id_order(b.id));
  });
  return out;
}

std::vector<Stretch> stretches_of(const std::vector<EdgeStations>& edges, double longest_mm) {
  constexpr double kTurn_cos = 0.5;  // a stretch's normals lie within 60 degrees of each other: a closed edge is several
  std::vector<Stretch> out;
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const auto& st = edges[e].stations;
    const auto holds = [&](std::size_t begin, std::size_t end) {
      const Vec3 a = (st[begin].n[0] + st[begin].n[1]).normalized();
      for (std::size_t k = begin; k < end; ++k) {
        if ((st[k].n[0] + st[k].n[1]).normalized().dot(a) < kTurn_cos) return false;
        for (std::size_t j = begin; j < k; ++j)
          if ((st[j].p - st[k].p).norm() > longest_mm) return false;
      }
      return true;
    };
    // the fewest equal pieces that hold
    std::size_t pieces = 1;
    const auto all_hold = [&] {
      for (std::size_t i = 0; i < pieces; ++i)
        if (!holds(i * st.size() / pieces, (i + 1) * st.size() / pieces)) return false;
      return true;
    };
    while (pieces < st.size() && !all_hold()) ++pieces;
    for (std::size_t i = 0; i < pieces && !st.empty(); ++i) {
      Stretch s;
      s.edge = static_cast<int>(e), s.begin = i * st.size() / pieces, s.end = (i + 1) * st.size() / pieces;
      Vec3 n = Vec3::Zero();
      for (std::size_t k = s.begin; k < s.end; ++k) s.middle += st[k].p, n += st[k].n[0] + st[k].n[1];
      s.middle /= static_cast<double>(s.end - s.begin);
      s.mean_normal = n.norm() > 1e-9 ? Vec3(n.normalized()) : st[s.begin].n[0];
      out.push_back(s);
    }
  }
  return out;
}

}  // namespace asbuilt::inspecting
