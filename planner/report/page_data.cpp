// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/report/page_data.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>

#include "planner/base/number.hpp"
#include "planner/report/json_text.hpp"

namespace asbuilt {

namespace {

constexpr std::size_t kMostTriangles = 24000, kMostCloudPoints = 12000;

Json flat(const std::vector<Vec3>& p, int decimals) {
  Json a = Json::array();
  for (const Vec3& v : p)
    for (int i = 0; i < 3; ++i) a.push_back(number(v(i), decimals));
  return a;
}

void put16(std::string& bytes, std::uint32_t v) { bytes += static_cast<char>(v & 255), bytes += static_cast<char>(v >> 8 & 255); }
void put32(std::string& bytes, std::uint32_t v) { put16(bytes, v & 0xffff), put16(bytes, v >> 16); }

std::string packed(const std::vector<Vec3>& p, const Box3& box) {  // 16 bits a coordinate over the box, base64
  std::string bytes;
  for (const Vec3& v : p)
    for (int i = 0; i < 3; ++i) {
      const double size = box.max_mm(i) - box.min_mm(i), at = size > 0 ? (v(i) - box.min_mm(i)) / size : 0;
      put16(bytes, static_cast<std::uint32_t>(std::lround(std::clamp(at, 0.0, 1.0) * 65535)));
    }
  return base64(bytes);
}

/// Points of a polyline that keep it within `chord_mm`.
std::vector<Vec3> thinned_line(const std::vector<Vec3>& p, double chord_mm) {
  if (p.size() < 3) return p;
  std::vector<Vec3> out{p.front()};
  std::size_t from = 0;
  for (std::size_t i = 2; i < p.size(); ++i) {
    const Vec3 d = p[i] - p[from];
    const double l2 = d.squaredNorm();
    bool holds = l2 > 0;
    for (std::size_t k = from + 1; k < i && holds; ++k) holds = (p[k] - p[from] - d * ((p[k] - p[from]).dot(d) / l2)).norm() <= chord_mm;
    if (!holds) out.push_back(p[from = i - 1]);
  }
  out.push_back(p.back());
  return out;
}

Json mesh_json(const Brep& brep, const Box3& box) {
  const Mesh mesh = thinned(brep.mesh, kMostTriangles);
  std::string triangles;
  for (const auto& t : mesh.triangles)
    for (const int v : t) put32(triangles, static_cast<std::uint32_t>(v));
  return {{"v", packed(mesh.vertices, box)}, {"t", base64(triangles)}};
}

const Recipe* recipe_of(const ItemRecord& r, const std::string& feature) {
  if (!r.job) return nullptr;
  for (const FeatureSpec& f : r.job->part.features)
    if (f.id == feature) return r.job->recipe(f.recipe);
  return nullptr;
}

/// Certified clearance of the passes over an edge, the least where several go over it; empty where no motion was planned.
std::vector<double> clearance_at(const ItemRecord& r, std::size_t edge, std::size_t count) {
  if (!r.motion || !r.tool_path) return {};
  double least = 1e9;
  for (const MotionSegment& s : r.motion->segments) {
    if (s.kind != SegmentKind::cut || s.pass < 0 || static_cast<std::size_t>(s.pass) >= r.tool_path->passes.size()) continue;
    const auto& edges = r.tool_path->passes[static_cast<std::size_t>(s.pass)].edges;
    if (std::find(edges.begin(), edges.end(), static_cast<int>(edge)) != edges.end()) least = std::min(least, s.clearance_mm);
  }
  return least < 1e8 ? std::vector<double>(count, least) : std::vector<double>{};
}

/// Of the last pass that goes over this edge alone.
std::vector<double> probability_at(const ItemRecord& r, std::size_t edge, const std::vector<double>& s_mm) {
  if (!r.tool_path) return {};
  std::vector<double> p;
  for (const CutPass& pass : r.tool_path->passes) {
    if (pass.edges != std::vector<int>{static_cast<int>(edge)}) continue;
    std::vector<std::pair<double, double>> known;
    for (const PathPoint& point : pass.points)
      if (point.kind == PathPointKind::cut) known.emplace_back(point.s_mm, point.probability_ratio);
    if (known.empty()) continue;
    std::sort(known.begin(), known.end());
    p.clear();
    for (const double s : s_mm) {
      auto after = std::lower_bound(known.begin(), known.end(), std::make_pair(s, -1.0));
      if (after == known.end() || (after != known.begin() && s - std::prev(after)->first < after->first - s)) --after;
      p.push_back(after->second);
    }
  }
  return p;
}

Json edge_data(const ItemRecord& r, std::size_t k) {
  const AdaptedEdge& e = r.features->edges[k];
  Json j;
  j["id"] = e.id;
  j["feature"] = e.feature;
  j["s"] = numbers(e.s_mm, 2);
  j["nominal"] = flat(e.nominal, 3);
  j["adapted"] = flat(e.adapted, 4);
  j["deviation"] = numbers(deviation_mm(e), 4);
  if (e.rigid_mm.size() == e.s_mm.size()) j["rigid"] = numbers(e.rigid_mm, 4);
  if (e.feature_mm.size() == e.s_mm.size()) j["shape"] = numbers(e.feature_mm, 4);
  if (e.local_mm.size() == e.s_mm.size()) j["local"] = numbers(e.local_mm, 4);
  j["sigma"] = numbers(e.sigma_mm, 4);
  Json status = Json::array();
  for (const StationStatus s : e.status) status.push_back(static_cast<int>(s));
  if (e.status.size() == e.s_mm.size()) j["status"] = std::move(status);
  if (r.burrs && k < r.burrs->edges.size()) {
    const EdgeBurr& b = r.burrs->edges[k];
    j["burr"] = {{"height", numbers(b.height_mm, 3)}, {"sd", numbers(b.height_sd_mm, 3)}, {"width", numbers(b.width_mm, 3)}, {"limit", number(b.detection_limit_mm, 3)}};
  }
  if (r.tool_path && k < r.tool_path->edge_feed_mm_s.size()) j["feed"] = numbers(r.tool_path->edge_feed_mm_s[k], 2);
  if (r.tool_path && k < r.tool_path->edge_passes_count.size()) j["passes"] = r.tool_path->edge_passes_count[k];
  if (const auto c = clearance_at(r, k, e.s_mm.size()); !c.empty()) j["clearance"] = numbers(c, 3);
  if (const auto p = probability_at(r, k, e.s_mm); !p.empty()) j["probability"] = numbers(p, 5);
  if (const Recipe* recipe = recipe_of(r, e.feature))
    j["limits"] = {{"burr", recipe->burr_max_height_mm}, {"feed_min", recipe->feed_min_mm_s}, {"feed_max", recipe->feed_max_mm_s}, {"tolerance", recipe->tolerance_mm}, {"gate", recipe->gate_probability_ratio}};
  return j;
}

Json moves_json(const ItemRecord& r) {  // approach, retract and transfers, in part
  Json moves = Json::array();
  const Pose<frame::Part, frame::Base> T_part_base = r.location->T_base_part.inverse();
  for (const MotionSegment& s : r.motion->segments) {
    if (s.kind == SegmentKind::cut) continue;
    std::vector<Vec3> p;
    for (const auto& T : s.T_base_tool) p.push_back(T_part_base.point(T.p_mm));
    moves.push_back({{"kind", std::string(name_of(s.kind))}, {"p", flat(thinned_line(p, 0.1), 1)}});
  }
  return moves;
}

/// Some of the measured points near the part, seen from the located part, or from its drawing's place where it was not located.
std::vector<Vec3> cloud_sample(const ItemRecord& r, const Box3& box) {
  std::vector<Vec3> p;
  const auto T_base_part = r.location ? r.location->T_base_part : r.job->fixture.T_base_fixture * r.job->fixture.T_fixture_part;
  const auto T_part_base = T_base_part.inverse();
  const std::size_t step = std::max<std::size_t>(1, r.cloud->p_base.size() / kMostCloudPoints);
  for (std::size_t i = 0; i < r.cloud->p_base.size(); i += step) {
    const Vec3 q = T_part_base.point(r.cloud->p_base[i]);
    if ((q - q.cwiseMax(box.min_mm).cwiseMin(box.max_mm)).norm() < 1.5) p.push_back(q);
  }
  return p;
}

/// True where the text holds the id as a whole word: "#10" is not named by "#103".
bool names(const std::string& text, const std::string& id) {
  if (id.empty()) return false;
  for (std::size_t at = text.find(id); at != std::string::npos; at = text.find(id, at + 1)) {
    const std::size_t end = at + id.size();
    if (end == text.size() || !std::isalnum(static_cast<unsigned char>(text[end]))) return true;
  }
  return false;
}

/// Edges the recipes work, as drawn, where none was fitted; those a reason names are marked.
Json wanted_json(const ItemRecord& r) {
  Json wanted = Json::array();
  for (const FeatureSpec& f : r.job->part.features)
    for (const int k : f.edges) {
      if (k < 0 || static_cast<std::size_t>(k) >= r.job->part.brep.edges.size()) continue;
      const BrepEdge& e = r.job->part.brep.edges[static_cast<std::size_t>(k)];
      const bool is_blamed = std::any_of(r.reasons.begin(), r.reasons.end(), [&](const Refusal& why) { return names(why.where + " " + why.message, e.id); });
      wanted.push_back({{"id", e.id}, {"feature", f.id}, {"blamed", is_blamed}, {"p", flat(thinned_line(e.p, 0.02), 2)}});
    }
  return wanted;
}

}  // namespace

std::string base64(const std::string& bytes) {
  static const char* letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t v = 0;
    for (std::size_t k = 0; k < 3; ++k) v = v << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    for (std::size_t k = 0; k < 4; ++k) text += i + k > bytes.size() ? '=' : letters[v >> (18 - 6 * k) & 63];
  }
  return text;
}

Mesh thinned(const Mesh& mesh, std::size_t most) {
  if (mesh.triangles.size() <= most) return mesh;
  const Box3 box = mesh.box();
  Mesh best = mesh;
  for (double cells = 400; cells >= 20 && best.triangles.size() > most; cells *= 0.8) {
    const double size_mm = box.diagonal_mm() / cells;
    std::map<std::array<long, 3>, int> places;
    std::vector<int> to(mesh.vertices.size());
    best = {};
    for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
      const Vec3 q = (mesh.vertices[i] - box.min_mm) / size_mm;
      const auto [at, is_new] = places.try_emplace({std::lround(q.x()), std::lround(q.y()), std::lround(q.z())}, static_cast<int>(best.vertices.size()));
      if (is_new) best.vertices.push_back(mesh.vertices[i]);
      to[i] = at->second;
    }
    for (const auto& t : mesh.triangles) {
      const std::array<int, 3> f{to[static_cast<std::size_t>(t[0])], to[static_cast<std::size_t>(t[1])], to[static_cast<std::size_t>(t[2])]};
      if (f[0] != f[1] && f[1] != f[2] && f[2] != f[0]) best.triangles.push_back(f);
    }
  }
  return best;
}

std::vector<double> deviation_mm(const AdaptedEdge& edge) {
  std::vector<double> d;
  for (std::size_t i = 0; i < std::min(edge.nominal.size(), edge.adapted.size()); ++i) d.push_back((edge.adapted[i] - edge.nominal[i]).norm());
  return d;
}

Json page_data(const ItemRecord& r) {
  Json j;
  Box3 box;
  if (r.job) {
    for (const Vec3& v : r.job->part.brep.mesh.vertices) box.extend(v);
    for (const BrepEdge& e : r.job->part.brep.edges)
      for (const Vec3& p : e.p) box.extend(p);
  }
  double deviation_max = 0;
  std::size_t first = 0;
  if (r.features)
    for (std::size_t k = 0; k < r.features->edges.size(); ++k) {
      for (const Vec3& p : r.features->edges[k].nominal) box.extend(p);
      for (const double d : deviation_mm(r.features->edges[k]))
        if (d > deviation_max) deviation_max = d, first = k;
    }
  if (box.is_empty()) box.min_mm = Vec3::Zero(), box.max_mm = Vec3::Ones();
  j["box"] = Json::array({point(box.min_mm, 4), point(box.max_mm, 4)});
  box.min_mm = Vec3(rounded(box.min_mm.x(), 4), rounded(box.min_mm.y(), 4), rounded(box.min_mm.z(), 4));
  box.max_mm = Vec3(rounded(box.max_mm.x(), 4), rounded(box.max_mm.y(), 4), rounded(box.max_mm.z(), 4));
  j["deviation_max"] = number(deviation_max, 4);
  double exaggeration = 1;
  for (const double k : {2.0, 5.0, 10.0, 20.0, 50.0, 100.0})
    if (k * deviation_max < 0.02 * box.diagonal_mm()) exaggeration = k;
  j["exaggeration"] = exaggeration;
  j["edge_first"] = first;
  if (r.job && !r.job->part.brep.mesh.triangles.empty()) j["mesh"] = mesh_json(r.job->part.brep, box);
  j["lines"] = Json::array();
  if (r.job)
    for (const BrepEdge& e : r.job->part.brep.edges)
      if (!e.is_seam && e.kind != EdgeKind::smooth) j["lines"].push_back(flat(thinned_line(e.p, box.diagonal_mm() * 2e-4), 2));
  j["edges"] = Json::array();
  if (r.features)
    for (std::size_t k = 0; k < r.features->edges.size(); ++k) j["edges"].push_back(edge_data(r, k));
  if (r.job && !r.features) j["wanted"] = wanted_json(r);
  j["passes"] = Json::array();
  if (r.tool_path)
    for (const CutPass& pass : r.tool_path->passes) {
      std::vector<Vec3> tips;
      for (const PathPoint& p : pass.points) tips.push_back(p.tip_part);
      j["passes"].push_back({{"feature", pass.feature}, {"pass", pass.pass}, {"tip", flat(thinned_line(tips, 0.01), 3)}});
    }
  if (r.motion && r.location) j["moves"] = moves_json(r);
  if (r.cloud && (r.location || r.job) && !r.cloud->p_base.empty()) j["cloud"] = packed(cloud_sample(r, box), box);
  return j;
}

}  // namespace asbuilt
