// SPDX-License-Identifier: GPL-3.0-or-later
// Jobs for the inspection planner, built in memory: a block on a table before a box robot, any CAD before any URDF arm; what simulated
// captures see of the edges; and the part mirrored or its edges shuffled.
#pragma once

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <regex>
#include <unordered_map>

#include "planner/artefacts/inspection.hpp"
#include "planner/geom/mesh_brep.hpp"
#include "planner/io/mesh_file.hpp"
#include "planner/io/step/step_reader.hpp"
#include "planner/io/urdf.hpp"
#include "planner/plan/inspect/stations.hpp"
#include "planner/robot/robot.hpp"
#include "tests/unit/motion/small_cell.hpp"

namespace asbuilt::test {

struct InspectScene {
  Job job;
  Location location;
};

inline Mesh joined(Mesh a, const Mesh& b) {
  const int n = static_cast<int>(a.vertices.size());
  a.vertices.insert(a.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const auto& t : b.triangles) a.triangles.push_back({t[0] + n, t[1] + n, t[2] + n});
  return a;
}

/// A sensor beside the tool that looks at the tool's axis, `beyond_mm` past the tip; sizes times `f`.
inline SensorSpec detail_sensor(double tool_length_mm, double f = 1, double beyond_mm = 24) {
  SensorSpec s;
  s.id = "detail", s.is_calibrated = true;
  const double tilt = rad_from_deg(33), wd = 206 * f;
  const Vec3 look(-std::sin(tilt), 0, std::cos(tilt));
  s.T_flange_sensor = {quat_from_z(look, Vec3::UnitY()), Vec3(0, 0, tool_length_mm + beyond_mm) - wd * look};
  s.range_mm = {171 * f, 241 * f}, s.working_distance_mm = wd, s.field_of_view_mm = {120 * f, 75 * f}, s.noise_mm = 0.006;
  s.pixels_count = {400, 250}, s.second_ray_mm = Vec3(90 * f, 0, 0), s.incidence_max_rad = rad_from_deg(68);
  s.covariance.diagonal() << 2.4e-4, 2.4e-4, 1.3e-4, 2.5e-9, 2.5e-9, 2.5e-9;
  // the body sits behind the eye, on the line of sight
  s.mesh_flange = transformed(s.T_flange_sensor, box_mesh(Vec3(-60, -35, -90) * f, Vec3(60, 35, -6) * f));
  return s;
}

inline void add_features(Job& job, const std::vector<int>& edges) {
  job.part.features = {{"top", job.recipes.front().id, edges}};
}

inline std::vector<int> sharp_convex_edges(const Brep& brep, const std::function<bool(const BrepEdge&)>& wanted) {
  std::vector<int> out;
  for (std::size_t i = 0; i < brep.edges.size(); ++i)
    if (brep.edges[i].kind == EdgeKind::sharp_convex && brep.edges[i].fault.empty() && wanted(brep.edges[i])) out.push_back(static_cast<int>(i));
  return out;
}

/// The block of small_cell with its four top edges to be worked. `extra`: more of the part (towers that hide, and the like).
inline InspectScene block_scene(const Mesh& part = box_mesh(Vec3::Zero(), {kBlockX, kBlockY, kBlockZ})) {
  SmallCell c = small_cell();
  InspectScene s{c.job, c.location};
  s.job.cell.sensors = {detail_sensor(350)};
  s.job.cell.tools[0].mesh_flange = joined(box_mesh({-45, -45, 0}, {45, 45, 200}), box_mesh({-20, -20, 200}, {20, 20, 294}));  // slim, so that the sensor sees past it
  s.job.cell.tools[0].covariance.diagonal() << 5e-5, 5e-5, 5e-5, 4e-10, 4e-10, 4e-10;
  s.job.part.brep = brep_from_mesh(part);
  s.job.part.id = "block", s.job.batch_id = "test", s.job.taken = "2026-11-22";
  s.job.recipes[0].axis_base = -Vec3::UnitZ();
  s.location.covariance.diagonal() << 0.01, 0.01, 0.01, 1e-7, 1e-7, 1e-7;
  add_features(s.job, sharp_convex_edges(s.job.part.brep, [&](const BrepEdge& e) {
                 return std::all_of(e.p.begin(), e.p.end(), [](const Vec3& p) { return std::abs(p.z() - kBlockZ) < 1e-6; });
               }));
  return s;
}

inline std::string bytes_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// A robot of ../shared/data/robots with its collision meshes; none where it is not there or not six turning joints.
inline std::optional<RobotSpec> robot_of_urdf(const std::filesystem::path& folder) {
  const std::string name = folder.filename(), table = bytes_of(folder / "fk_cases.csv");
  std::smatch m;
  if (!std::regex_search(table, m, std::regex("base=(\\S+) tip=(\\S+);"))) return std::nullopt;
  auto read = read_urdf(bytes_of(folder / (name + ".urdf")), name, m[1], m[2]);
  if (!read) return std::nullopt;
  RobotSpec spec;
  spec.model = name;
  spec.kinematics = read->artefact.kinematics;
  for (std::size_t i = 0; i < 6; ++i)
    spec.joints[i] = {read->artefact.limits_rad[i][0], read->artefact.limits_rad[i][1], read->artefact.speed_rad_s[i], 10, 100};
  for (const UrdfShape& s : read->artefact.shapes) {
    Mesh mesh = s.mesh_shape;
    if (!s.file.empty()) {
      auto loaded = read_mesh(bytes_of(folder / s.file), s.file, 1000.0);
      if (!loaded) return std::nullopt;
      mesh = loaded->mesh;
      for (Vec3& v : mesh.vertices) v = v.cwiseProduct(s.scale);
    }
    spec.links.push_back({s.joint, transformed(s.T_base_shape, mesh)});
  }
  spec.accuracy.absolute = {0.42, 0.2}, spec.accuracy.repeatability = {0.07, 0.03}, spec.accuracy.short_term = {0.02, 0.01};
  return spec;
}

/// Any part on a table before any arm, tool and sensor as large as the arm carries, home above the part in the roomiest posture.
/// Worked: its sharp convex edges that look up, at least `least_mm` long, at most `most_count`, longest first.
inline std::optional<InspectScene> cad_scene(const RobotSpec& spec, const Brep& brep, double least_mm, std::size_t most_count) {
  const auto robot = Robot::from(spec);
  if (!robot) return std::nullopt;
  InspectScene s = block_scene();
  Job& job = s.job;
  const double f = std::clamp(robot->reach_mm() / 2600, 0.4, 1.0);
  const Vec3 shoulder = robot->axes(JointVector{})[1].second;
  job.part.brep = brep;
  const Box3 box = brep.mesh.box();
  const Vec3 middle = box.center_mm();
  const double table_z = shoulder.z() - 0.28 * robot->reach_mm();
  s.location.T_base_part.p_mm = Vec3(0.5 * robot->reach_mm(), 0, table_z) - Vec3(middle.x(), middle.y(), box.min_mm.z());
  job.cell.obstacles = {{"table", box_mesh(Vec3(0.5 * robot->reach_mm() - 300 * f, -350 * f, table_z - 60), Vec3(0.5 * robot->reach_mm() + 300 * f, 350 * f, table_z - 0.5))}};
  job.fixture = {};
  ToolSpec& tool = job.cell.tools[0];
  const double length = 295 * f + 55;
  tool.T_flange_tool.p_mm = {0, 0, length};
  tool.mesh_flange = box_mesh(Vec3(-45, -45, 1 / f) * f, Vec3(45, 45, 200) * f);
  tool.mesh_flange = joined(tool.mesh_flange, box_mesh(Vec3(-20 * f, -20 * f, 200 * f), Vec3(20 * f, 20 * f, 294 * f)));
  job.cell.sensors = {detail_sensor(length, std::max(f, 0.6), 20)};
  job.cell.robot = spec;
  double best = -1;
  for (int k = 0; k < 12; ++k) {
    const Pose<frame::Base, frame::Tool> T(quat_from_z(-Vec3::UnitZ(), Vec3(std::cos(k * kPi / 6), std::sin(k * kPi / 6), 0)),
                                           Vec3(0.5 * robot->reach_mm(), 0, table_z + (box.max_mm - box.min_mm).z() + 220 * f));
    for (const JointVector& q : robot->inverse(T * tool.T_flange_tool.inverse())) {
      const double room = std::min({robot->joint_margin_rad(q), 4 * robot->singularity_ratio(q), 0.5}) - 0.01 * std::abs(q[5]) - 0.02 * std::abs(q[3]);
      if (room > best) best = room, job.cell.robot.home_rad = q;
    }
  }
  if (best < 0) return std::nullopt;
  std::vector<int> edges = sharp_convex_edges(brep, [&](const BrepEdge& e) {
    if (e.length_mm < least_mm || e.n_1.size() != e.p.size() || e.n_1.empty()) return false;
    for (std::size_t k = 0; k < e.p.size(); ++k)
      if (e.n_1[k].z() < -0.05 || e.n_2[k].z() < -0.05 || (e.n_1[k] + e.n_2[k]).normalized().z() < 0.5) return false;
    return true;
  });
  std::stable_sort(edges.begin(), edges.end(), [&](int a, int b) { return brep.edges[static_cast<std::size_t>(a)].length_mm > brep.edges[static_cast<std::size_t>(b)].length_mm; });
  if (edges.size() > most_count) edges.resize(most_count);
  std::sort(edges.begin(), edges.end());
  if (edges.empty()) return std::nullopt;
  add_features(job, edges);
  return s;
}

/// Stations of edges against measured points: which have enough on both faces.
class SeenStations {
 public:
  /// `edges` in base, as they truly are.
  SeenStations(std::vector<inspecting::EdgeStations> edges, double station_mm) : edges_(std::move(edges)), station_mm_(station_mm) {
    for (std::size_t e = 0; e < edges_.size(); ++e)
      for (std::size_t k = 0; k < edges_[e].stations.size(); ++k) {
        const Key c = key(edges_[e].stations[k].p);
        grid_[packed(c[0], c[1], c[2])].push_back({e, k});
      }
    for (const auto& e : edges_) counts_.emplace_back(e.stations.size(), std::array<double, 2>{});
  }
  void add(const Vec3& p) {
    const Key c = key(p);
    for (int x = -1; x <= 1; ++x)
      for (int y = -1; y <= 1; ++y)
        for (int z = -1; z <= 1; ++z) {
          const auto it = grid_.find(packed(c[0] + x, c[1] + y, c[2] + z));
          if (it == grid_.end()) continue;
          for (const auto& [e, k] : it->second) {
            const auto& s = edges_[e].stations[k];
            const Vec3 d = p - s.p;
            if (std::abs(d.dot(s.tangent)) > 0.5 * station_mm_) continue;
            for (std::size_t f = 0; f < 2; ++f) {
              const double off = d.dot(s.into[f]);
              if (std::abs(d.dot(s.n[f])) < 0.25 && off >= inspecting::kBandFrom_mm && off <= inspecting::kBandTo_mm) ++counts_[e][k][f];
            }
          }
        }
  }
  double coverage(std::size_t edge, double least_count) const {
    std::size_t n = 0;
    for (const auto& c : counts_[edge]) n += c[0] >= least_count && c[1] >= least_count;
    return counts_[edge].empty() ? 0.0 : static_cast<double>(n) / static_cast<double>(counts_[edge].size());
  }
  double points(std::size_t edge) const {  // on both faces
    double n = 0;
    for (const auto& c : counts_[edge]) n += c[0] + c[1];
    return n;
  }
  const std::vector<inspecting::EdgeStations>& edges() const { return edges_; }

 private:
  using Key = std::array<long, 3>;
  static std::uint64_t packed(long x, long y, long z) { return (static_cast<std::uint64_t>(x & 0x1FFFFF) << 42) | (static_cast<std::uint64_t>(y & 0x1FFFFF) << 21) | static_cast<std::uint64_t>(z & 0x1FFFFF); }
  static Key key(const Vec3& p) { return {static_cast<long>(std::floor(p.x() / 3.5)), static_cast<long>(std::floor(p.y() / 3.5)), static_cast<long>(std::floor(p.z() / 3.5))}; }
  std::vector<inspecting::EdgeStations> edges_;
  double station_mm_;
  std::unordered_map<std::uint64_t, std::vector<std::pair<std::size_t, std::size_t>>> grid_;
  std::vector<std::vector<std::array<double, 2>>> counts_;
};

}  // namespace asbuilt::test
