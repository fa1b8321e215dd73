// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/simulate/simulate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <set>
#include <sstream>

#include "planner/base/archive.hpp"
#include "planner/base/number.hpp"
#include "planner/robot/robot.hpp"
#include "planner/simulate/files.hpp"
#include "planner/simulate/sensor.hpp"
#include "planner/simulate/part_model.hpp"
#include "planner/simulate/true_robot.hpp"

namespace asbuilt {
namespace {

using namespace simulate_detail;
using BaseFlange = Pose<frame::Base, frame::Flange>;
using BaseTool = Pose<frame::Base, frame::Tool>;

const std::set<std::string>& known_traps() {
  static const std::set<std::string> t = {"",           "lugs_missing", "flat_views",  "other_part",  "hand_eye",       "expired",     "truncated_ply",
                                          "nan_cloud",  "nan_points",   "step_cut",    "unknown_key", "missing_unit",   "edge_unscanned", "unreachable",
                                          "clamp",      "scale",        "points_lost", "revision",    "part_moved",     "edge_broken",    "tool_bumped"};
  return t;
}

struct Burr {  // one edge's burr, parallel to the edge's samples
  std::vector<double> height_mm, length_mm, width_mm;
  std::vector<Vec3> direction;
};

/// Height as a smooth random profile with bare stretches. A burr's fin leans away from the bisector; flash lies about in the
/// parting plane and curls a little.
Burr make_burr(const TrueEdge& e, const BurrStyle& style, Random& random) {
  Burr b;
  const double mean = random.uniform(style.mean_min_mm, style.mean_max_mm), lean = random.uniform(-0.5, 0.5);
  double slow = random.normal(), quick = random.normal();
  for (std::size_t i = 0; i < e.p.size(); ++i) {
    const double ds = i == 0 ? 0 : e.s_mm[i] - e.s_mm[i - 1];
    const double a = std::exp(-ds / 12), c = std::exp(-ds / 3);
    slow = a * slow + std::sqrt(1 - a * a) * random.normal();
    quick = c * quick + std::sqrt(1 - c * c) * random.normal();
    double h = mean * (1 + 0.45 * slow + 0.15 * quick);
    if (slow < -1.3) h = 0;
    h = std::clamp(h, 0.0, style.height_max_mm);
    const Vec3 bisector = (e.n_1[i] + e.n_2[i]).normalized(), across = bisector.cross(e.tangent[i]).normalized();
    Vec3 dir = (std::cos(lean) * bisector + std::sin(lean) * across).normalized();
    if (style.is_flash) dir = (e.n_2[i] + (0.25 + 0.4 * lean) * e.n_1[i]).normalized();
    const double per_length = std::max(e.n_1[i].dot(dir), e.n_2[i].dot(dir));
    b.direction.push_back(dir);
    b.height_mm.push_back(h);
    b.length_mm.push_back(h / per_length);
    b.width_mm.push_back(h > 0 ? style.root_mm + style.root_ratio * h : 0);
  }
  return b;
}

Mesh burr_mesh(const TrueEdge& e, const Burr& b) {
  Mesh m;
  for (std::size_t i = 0; i < e.p.size(); ++i) {
    const Vec3 in_1 = -(e.n_2[i] - e.n_1[i] * e.n_1[i].dot(e.n_2[i])).normalized(), in_2 = -(e.n_1[i] - e.n_2[i] * e.n_1[i].dot(e.n_2[i])).normalized();
    m.vertices.push_back(e.p[i] + 0.5 * b.width_mm[i] * in_1);
    m.vertices.push_back(e.p[i] + b.length_mm[i] * b.direction[i]);
    m.vertices.push_back(e.p[i] + 0.5 * b.width_mm[i] * in_2);
  }
  for (std::size_t i = 0; i + 1 < e.p.size(); ++i) {
    if (b.height_mm[i] <= 0 && b.height_mm[i + 1] <= 0) continue;
    const int a = static_cast<int>(3 * i);
    for (int side = 0; side < 2; ++side) {
      const int u = a + side, v = u + 1;
      m.triangles.push_back({u, v, u + 3}), m.triangles.push_back({v, v + 3, u + 3});
    }
  }
  return m;
}

template <class A, class B>
Pose<A, B> drawn(const Pose<A, B>& T, double sd_mm, double sd_rad, Random& r) {
  Vec6 xi;
  for (int i = 0; i < 3; ++i) xi[i] = r.normal(0, sd_mm);
  for (int i = 3; i < 6; ++i) xi[i] = r.normal(0, sd_rad);
  return T.disturbed(xi);
}

std::string covariance_text(double sd_mm, double sd_rad) {
  std::string t = "[";
  for (int i = 0; i < 6; ++i) {
    t += i ? ", [" : "[";
    for (int j = 0; j < 6; ++j) t += (j ? ", " : "") + (i == j ? shortest_number(i < 3 ? sd_mm * sd_mm : sd_rad * sd_rad) : std::string("0"));
    t += "]";
  }
  return t + "]";
}

/// Another revision of the part than the drawing's: `size` mm longer in x at 50 mm from its middle.
void revise(PartModel& part, double size) {
  const double k = size / 50;
  const auto moved = [&](Vec3 p) { return p.x() += k * (p.x() - part.pivot.x()), p; };
  for (Vec3& v : part.made.vertices) v = moved(v);
  for (TrueEdge& e : part.made_edges)
    for (std::size_t i = 0; i < e.p.size(); ++i) {
      e.p[i] = moved(e.p[i]);
      e.tangent[i].x() *= 1 + k, e.tangent[i].normalize();
      for (Vec3* n : {&e.n_1[i], &e.n_2[i]}) n->x() /= 1 + k, n->normalize();
    }
}

struct Shot {
  int sensor;
  std::string feature;  // empty: none
  BaseFlange T_base_flange;  // wanted
  std::optional<Joints> q_rad = {};  // where the posture is given with it
  std::string cloud = {};            // and the file's name
};

/// What hangs on the flange beside the sensor that looks: tool, cutter, the other sensors.
Mesh riding_mesh(const CellSpec& cell, int sensor) {
  const ToolSpec& tool = cell.tools[0];
  Mesh m = tool.mesh_flange;
  append(m, transformed(tool.T_flange_tool, cylinder_mesh(0.5 * tool.cutter.shank_diameter_mm, -tool.cutter.length_mm, 0, 16)));
  for (std::size_t k = 0; k < cell.sensors.size(); ++k)
    if (static_cast<int>(k) != sensor) append(m, cell.sensors[k].mesh_flange);
  return m;
}

/// Where the sensor looks from, for one worked boss: in working orientation from two sides, and leaning over the other two.
void add_detail_shots(std::vector<Shot>& shots, const std::string& feature, const std::vector<TrueEdge>& edges, const Pose<frame::Base, frame::Part>& T,
                      const ToolSpec& tool) {
  const double focus = tool.T_flange_tool.p_mm.z() + 12;
  Vec3 middle = Vec3::Zero();
  int n = 0;
  for (const TrueEdge& e : edges)
    if (e.feature == feature)
      for (const Vec3& p : e.p) middle += p, ++n;
  middle /= n;
  const auto shoot = [&](const Vec3& target, double azimuth, double lean) {
    const Vec3 x(std::cos(azimuth), std::sin(azimuth), 0);
    Eigen::Quaterniond q = quat_from_z(-Vec3::UnitZ(), x);
    if (lean != 0) q = Eigen::Quaterniond(Eigen::AngleAxisd(lean, Vec3(-x.y(), x.x(), 0))) * q;
    shots.push_back({1, feature, BaseFlange(q, target - q * Vec3(0, 0, focus))});
  };
  int k = 0;
  for (const TrueEdge& e : edges) {
    if (e.feature != feature) continue;
    // long edges in stretches that fit the field
    const int stretches = std::max(1, static_cast<int>(std::ceil(e.s_mm.back() / 60)));
    for (int j = 0; j < stretches; ++j) {
      const std::size_t middle_index = std::min(e.p.size() - 1, static_cast<std::size_t>((j + 0.5) / stretches * static_cast<double>(e.p.size())));
      const Vec3 at = e.p[middle_index], out = T.direction(e.n_2[middle_index]);
      const double azimuth = std::atan2(out.y(), out.x());
      const bool is_small = stretches == 1 && (at - middle).norm() < 40;  // then the whole feature fits the field
      const Vec3 target = T.point(is_small ? Vec3(0.5 * (at + middle)) : at);
      shoot(target, azimuth, 0);
      if (k % 2 == 1) shoot(target, azimuth, rad_from_deg(18));
    }
    ++k;
  }
}

void add_wide_shots(std::vector<Shot>& shots, const Vec3& target, const SensorSpec& wide, bool flat, const Robot& robot, Random& random) {
  for (int k = 0; k < 4; ++k) {
    const double azimuth = kPi / 4 + k * kPi / 2 + random.uniform(-0.1, 0.1), height = flat ? kPi / 2 - 0.02 : rad_from_deg(62);
    const Vec3 from(std::cos(azimuth) * std::cos(height), std::sin(azimuth) * std::cos(height), std::sin(height));
    std::optional<BaseFlange> best;
    double best_cost = 1e300;
    for (int roll = 0; roll < 12; ++roll) {
      const double a = 2 * kPi * roll / 12;
      const Pose<frame::Base, frame::Sensor> T_base_sensor(quat_from_z(-from, Vec3(std::cos(a), std::sin(a), 0)), target + wide.working_distance_mm * from);
      const BaseFlange T = T_base_sensor * wide.T_flange_sensor.inverse();
      if (const auto q = posture(robot, T)) {
        double cost = 0;
        for (int i = 0; i < 6; ++i) cost += std::abs((*q)[i] - robot.spec().home_rad[i]);
        if (cost < best_cost) best_cost = cost, best = T;
      }
    }
    if (best) shots.push_back({0, "", *best});
  }
}

/// Of the arm over 24 poses above the table, tool down, turned at random and tilted up to 0.6 rad; in the flange's own frame.
Pose<frame::Flange, frame::Flange> mean_error(const TrueRobot& arm, const Robot& robot, const Pose<frame::Flange, frame::Tool>& T_flange_tool, std::uint64_t seed) {
  Random random = Random::stream(seed, "poses of the calibration");
  Vec3 shift = Vec3::Zero(), turn = Vec3::Zero();
  int count = 0;
  while (count < 24) {
    const Eigen::Quaterniond down = quat_from_z(-Vec3::UnitZ(), Vec3::UnitX());
    const Eigen::Quaterniond q = quat_exp(Vec3(random.uniform(-0.6, 0.6), random.uniform(-0.6, 0.6), 0)) * quat_exp(random.uniform(-kPi, kPi) * Vec3::UnitZ()) * down;
    const Pose<frame::Base, frame::Tool> T(q, Vec3(random.uniform(1090, 1210), random.uniform(-60, 60), random.uniform(600, 720)));
    const auto joints = posture(robot, T * T_flange_tool.inverse());
    if (!joints) continue;
    const auto error = arm.nominal(*joints).inverse() * arm.actual(*joints);
    shift += error.p_mm / 24, turn += quat_log(error.q) / 24, ++count;
  }
  return {quat_exp(turn), shift};
}

}  // namespace

Result<Done<std::filesystem::path>> simulate(const Scenario& sc, const std::filesystem::path& out) {
  if (std::find(known_parts().begin(), known_parts().end(), sc.part) == known_parts().end() || !known_traps().contains(sc.trap))
    return refuse({.code = "input.bad_scenario", .where = sc.part + " " + sc.trap, .message = "found part '" + sc.part + "', trap '" + sc.trap +
                                                                                      "'; allowed: part ring | bracket | casting | freeform and the traps of docs/formats.md",
                   .stage = "input"});
  const std::string item = sc.item_id.empty() ? fmt::format("{}-{:04}", sc.part, sc.seed) : sc.item_id;
  const std::filesystem::path batch = out / "batch", truth = out / "truth";
  Random random = Random::stream(sc.seed, "virtual cell");

  // ---- the part, as drawn and as made
  PartModel part = make_part(sc.part, sc.seed, sc.trap == "other_part" ? (sc.part == "ring" ? "bracket" : "ring") : "", sc.trap != "lugs_missing");
  if (sc.trap == "revision") revise(part, sc.trap_size);
  if (sc.width_mm > 0) part.width_mm = sc.width_mm;
  if (sc.tolerance_mm > 0) part.tolerance_mm = sc.tolerance_mm;
  const std::vector<TrueEdge>&nominal_edges = part.drawn_edges, &edges = part.made_edges;
  std::vector<Burr> burrs;
  Random burr_random = Random::stream(sc.seed, "burr");
  for (const TrueEdge& e : edges) burrs.push_back(make_burr(e, part.burr, burr_random));

  if (sc.trap == "edge_broken" && !burrs.empty())
    for (std::size_t k = 0; k < edges[0].p.size(); ++k)
      if (std::abs(edges[0].s_mm[k] - 0.5 * edges[0].s_mm.back()) < 0.27 * edges[0].s_mm.back()) burrs[0].height_mm[k] = burrs[0].length_mm[k] = burrs[0].width_mm[k] = 0;

  // ---- cell, calibration, robot
  const CellSpec cell = virtual_cell();
  const auto made_robot = Robot::from(cell.robot);
  must(made_robot.has_value(), "the virtual robot was refused");
  const Robot& robot = *made_robot;
  Random calibration_random = Random::stream(sc.seed, "calibration");
  const double sd_wide = 0.07, sd_wide_rad = 1e-4, sd_detail = 0.014, sd_detail_rad = 5e-5, sd_tool = 0.007, sd_tool_rad = 2e-5;
  std::vector<Pose<frame::Flange, frame::Sensor>> mount_true, mount_given;
  for (std::size_t i = 0; i < cell.sensors.size(); ++i) {
    mount_true.push_back(drawn(cell.sensors[i].T_flange_sensor, 0.4, 0.003, calibration_random));
    mount_given.push_back(drawn(mount_true[i], i == 0 ? sd_wide : sd_detail, i == 0 ? sd_wide_rad : sd_detail_rad, calibration_random));
  }
  if (sc.trap == "hand_eye") {
    Vec6 xi;
    xi << 0.707, 0.707, 0, 0, 0, 0;
    xi *= 1.5 * sc.trap_size;
    mount_given[1] = mount_given[1].disturbed(xi);
  }
  const auto tool_true = drawn(cell.tools[0].T_flange_tool, 0.3, 0.0003, calibration_random);
  auto tool_given = drawn(tool_true, sd_tool, sd_tool_rad, calibration_random);
  if (sc.trap == "tool_bumped") tool_given.p_mm += 0.3 * sc.trap_size * Vec3(0.6, 0.8, 0);
  // ---- devices: form and scale are the same in every picture
  std::vector<SensorModel> models(2);
  models[0].pitch_mm = 2.2, models[0].noise_mm = 0.18, models[0].correlation_px = 1.0, models[0].bias_mm = 0.05, models[0].baseline_mm = 140;
  models[0].slope_power = 1, models[0].scale_ppm = 300, models[0].specular_ratio = 0.01;
  models[1].pitch_mm = sc.is_light ? 0.42 : 0.30, models[1].noise_mm = 0.006, models[1].correlation_px = 0.8, models[1].bias_mm = 0.005, models[1].baseline_mm = 90;
  models[1].slope_power = 2, models[1].scale_ppm = 100, models[1].specular_ratio = 0.005;
  Random device_random = Random::stream(sc.seed, "device");
  for (SensorModel& m : models) draw_device(m, device_random);

  const TrueRobot arm = arm_of(cell.robot, cell.tools[0].T_flange_tool, sc.seed);
  {  // Both are calibrated by moving this arm about the cell: its mean error over those poses goes into both, and into a sensor's what its scale is off by at the
     // distance that it works in.
    const Pose<frame::Flange, frame::Flange> mean = mean_error(arm, robot, tool_given, sc.seed);
    for (std::size_t i = 0; i < mount_given.size(); ++i) {
      const Vec3 shift(0, 0, -models[i].scale * cell.sensors[i].working_distance_mm);
      mount_given[i] = mean * mount_given[i] * Pose<frame::Sensor, frame::Sensor>(Eigen::Quaterniond::Identity(), shift);
    }
    tool_given = mean * tool_given;
  }

  // ---- fixture and mounting
  const double lift = 22;
  const bool is_turned = part.axis.has_value();
  const Pose<frame::Base, frame::Fixture> T_base_fixture(Eigen::Quaterniond(Eigen::AngleAxisd(random.uniform(-0.15, 0.15), Vec3::UnitZ())),
                                                         Vec3(random.uniform(1120, 1180), random.uniform(-40, 40), 590));
  const auto T_base_fixture_true = drawn(T_base_fixture, 0.08, 0.0001, random);
  const Pose<frame::Fixture, frame::Part> T_fixture_part(Eigen::Quaterniond::Identity(), Vec3(0, 0, lift) - part.pivot);
  const Vec3 play(5, 5, 2);
  const double play_tilt = rad_from_deg(1.0), play_turn = rad_from_deg(3.5);
  double tilt = sc.tilt_rad >= 0 ? sc.tilt_rad : random.uniform(0, play_tilt);
  const double tilt_azimuth = random.uniform(0, 2 * kPi);
  const double turn = sc.turn_rad >= 0 && is_turned ? sc.turn_rad : is_turned ? random.uniform(0, 2 * kPi) : random.uniform(-play_turn, play_turn);
  const Vec3 shift(random.uniform(-play.x(), play.x()), random.uniform(-play.y(), play.y()), random.uniform(0, play.z()));
  Pose<frame::Part, frame::Part> displaced;
  {
    const Eigen::Quaterniond lean = quat_exp(tilt * Vec3(std::cos(tilt_azimuth), std::sin(tilt_azimuth), 0));
    const Vec3 pivot = part.pivot;
    displaced.q = (lean * Eigen::Quaterniond(Eigen::AngleAxisd(turn, Vec3::UnitZ()))).normalized();
    displaced.p_mm = pivot - displaced.q * pivot + shift;
  }
  const Pose<frame::Base, frame::Part> T_base_part = T_base_fixture_true * T_fixture_part * displaced;
  const Vec3 half = part.support_mm;
  Mesh fixture_mesh = part.is_round_support ? cylinder_mesh(half.x(), 0, lift - 2.5, 32) : box_mesh(-half, Vec3(half.x(), half.y(), lift - 2.5));
  if (sc.trap == "clamp" && !edges.empty()) {
    // a strap over the first worked edge, drawn in the fixture's mesh and really there
    const TrueEdge& e = edges.front();
    const Vec3 at = (T_base_fixture_true.inverse() * T_base_part).point(e.p[e.p.size() / 2]);
    append(fixture_mesh, box_mesh(at + Vec3(-11, -11, 3), at + Vec3(11, 11, 18)));
  }

  // ---- the scene the sensors see, in base
  Mesh scene = transformed(T_base_part, part.made);
  for (std::size_t i = 0; i < edges.size(); ++i) append(scene, transformed(T_base_part, burr_mesh(edges[i], burrs[i])));
  append(scene, transformed(T_base_fixture_true, fixture_mesh));
  append(scene, cell.obstacles[0].mesh_base);
  const MeshQuery seen(scene);
  MeshQuery seen_before;  // the part is knocked between the first half of the pictures and the second
  if (sc.trap == "part_moved") {
    Mesh before = scene;
    const Vec3 shift = 0.5 * sc.trap_size * Vec3(0.8, -0.6, 0);
    const std::size_t own = part.made.vertices.size();
    for (std::size_t i = 0; i < own; ++i) before.vertices[i] += shift;
    seen_before = MeshQuery(before);
  }

  // ---- captures
  std::vector<Shot> shots;
  const Pose<frame::Base, frame::Part> T_expected = T_base_part;  // the inspection plan looked where the part was roughly found
  add_wide_shots(shots, T_expected.point(part.look_at), cell.sensors[0], sc.trap == "flat_views", robot, random);
  for (const PlannedCapture& p : sc.captures) {
    const auto it = std::find_if(cell.sensors.begin(), cell.sensors.end(), [&](const SensorSpec& x) { return x.id == p.sensor; });
    if (it == cell.sensors.end())
      return refuse({.code = "input.bad_scenario", .where = "captures", .message = "found a capture of sensor '" + p.sensor + "', which the virtual cell has not", .stage = "input"});
    shots.push_back({static_cast<int>(it - cell.sensors.begin()), p.feature, robot.forward(p.q_rad), p.q_rad, p.cloud});
  }
  if (sc.trap != "flat_views" && sc.captures.empty())
    for (const std::string& f : part.features) {
      if (sc.trap == "edge_unscanned" && f == part.features.back()) continue;
      add_detail_shots(shots, f, nominal_edges, T_expected, cell.tools[0]);
    }
  // The first detail view once more, last of all: whether the part still sits where it sat.
  if (sc.captures.empty())
    if (const auto first = std::find_if(shots.begin(), shots.end(), [](const Shot& s) { return s.sensor == 1; }); first != shots.end()) shots.push_back(Shot(*first));
  std::vector<Chip> chips;
  if (sc.trap == "edge_broken" && !edges.empty()) {
    const TrueEdge& e = edges.front();
    const std::size_t k = e.p.size() / 2;
    chips.push_back({T_base_part.point(e.p[k]), T_base_part.direction(e.tangent[k]), T_base_part.direction((e.n_1[k] + e.n_2[k]).normalized()),
                     0.25 * e.s_mm.back(), 0.6 * sc.trap_size});
  }
  std::string scans = fmt::format("asbuilt: scans/1\nitem: {}\ntaken: '2026-11-22'\ncaptures:\n", item);
  Random scatter = Random::stream(sc.seed, "scatter"), sensor_random = Random::stream(sc.seed, "sensor");

  if (sc.trap == "scale") models[1].scale += 5e-3 * sc.trap_size;
  int n_of[2] = {0, 0};
  Json captures_truth = Json::array();
  for (std::size_t shot_index = 0; shot_index < shots.size(); ++shot_index) {
    const Shot& shot = shots[shot_index];
    const auto q = shot.q_rad ? shot.q_rad : posture(robot, shot.T_base_flange);
    if (!q) continue;

    JointVector q_written{};
    for (int i = 0; i < 6; ++i) q_written[i] = rad_from_deg(rounded(deg_from_rad((*q)[i]), 6));
    const BaseFlange T_true = arm.actual(q_written, scatter);
    const SensorModel& model = models[shot.sensor];
    std::optional<MeshQuery> with_tool;  // a planned view is taken with the tool and the other sensor in the picture
    if (shot.q_rad) {
      Mesh all = scene;
      append(all, transformed(T_true, riding_mesh(cell, shot.sensor)));
      with_tool.emplace(std::move(all));
    }
    std::vector<Eigen::Vector3f> points = scan(with_tool ? *with_tool : sc.trap == "part_moved" && shot_index < shots.size() / 2 ? seen_before : seen, cell.sensors[shot.sensor],
                                               model, T_true * mount_true[shot.sensor], sensor_random, chips);
    if (sc.trap == "edge_unscanned" && shot.sensor == 0) {  // nobody saw that boss
      Vec3 middle = Vec3::Zero();
      int n = 0;
      for (const TrueEdge& e : edges)
        if (e.feature == part.features.back())
          for (const Vec3& p : e.p) middle += p, ++n;
      middle = T_base_part.point(middle / n);
      const auto T = T_true * mount_true[0];
      std::erase_if(points, [&](const Eigen::Vector3f& p) { return (T.point(p.cast<double>()) - middle).norm() < 55; });
    }
    if (sc.trap == "points_lost") lose_points(points, sc.trap_size, sensor_random);
    if (points.size() < 50) continue;  // nobody files an empty picture
    if (sc.trap == "nan_cloud")
      for (Eigen::Vector3f& p : points) p.setConstant(std::nanf(""));
    if (sc.trap == "nan_points")
      for (std::size_t i = 0; i < points.size(); i += 97) points[i].y() = std::nanf("");
    const std::string name = shot.cloud.empty() ? fmt::format("{}_{:02}.ply", cell.sensors[shot.sensor].id, n_of[shot.sensor]++) : shot.cloud;
    write_cloud(batch / item / name, points);
    const BaseFlange T_commanded = robot.forward(q_written);
    const std::string pose = sc.seed % 3 == 0   ? joints_text(q_written)
                             : sc.seed % 3 == 1 ? pose_text(T_commanded)
                                                : pose_text_zyx(T_commanded.q, T_commanded.p_mm);
    scans += fmt::format("- sensor: {}\n  cloud: {}\n  base_flange: {}\n", cell.sensors[shot.sensor].id, name, pose);
    if (!shot.feature.empty()) scans += fmt::format("  feature: {}\n", shot.feature);
    const auto seen_as = T_commanded * mount_given[shot.sensor];
    captures_truth.push_back({{"cloud", name}, {"points", points.size()}, {"feature", shot.feature}, {"base_sensor_true", to_json(T_true * mount_true[shot.sensor])}, {"base_sensor_given", to_json(seen_as)}});
  }
  write_text(batch / item / "scans.yaml", scans);
  if (sc.trap == "truncated_ply") {
    const auto file = batch / item / "wide_00.ply";
    std::filesystem::resize_file(file, std::filesystem::file_size(file) * 2 / 3);
  }

  // ---- the other files
  write_cell_meshes(batch, cell);
  write_stl(batch / "meshes/fixture.stl", fixture_mesh);
  write_text(batch / "cell.yaml", cell_text(cell));
  std::string calibration = fmt::format("asbuilt: calibration/1\ncell: cell.yaml\ncreated: '{}'\nvalid_days: 30\nsensors:\n",
                                        sc.trap == "expired" ? "2026-09-01" : "2026-11-14");
  for (std::size_t i = 0; i < cell.sensors.size(); ++i)
    calibration += fmt::format("  {}:\n    flange_sensor: {}\n    covariance: {}\n    rms: {}\n    captures: 24\n", cell.sensors[i].id, pose_text(mount_given[i]),
                               covariance_text(i == 0 ? sd_wide : sd_detail, i == 0 ? sd_wide_rad : sd_detail_rad), i == 0 ? 0.08 : 0.017);
  calibration += fmt::format("tools:\n  {}:\n    flange_tool: {}\n    covariance: {}\nrobot: {{}}\n", cell.tools[0].id, pose_text(tool_given),
                             covariance_text(sd_tool, sd_tool_rad));
  write_text(batch / "calibration.yaml", calibration);
  // the play of the part's own origin: where the part turns about its middle, the origin swings
  const double swing = part.pivot.head<2>().norm();
  const Vec3 play_given = play + Vec3(1, 1, 0) * std::ceil(swing * play_turn) + Vec3(0, 0, std::ceil(swing * play_tilt));
  write_text(batch / "fixture.yaml",
             fmt::format("asbuilt: fixture/1\nbase_fixture: {}\nmesh: meshes/fixture.stl\nfixture_part: {}\nplay: {{xyz: [{}, {}, {}], rpy: [{}, {}, {}]}}\n",
                         pose_text(T_base_fixture), pose_text(T_fixture_part), play_given.x(), play_given.y(), play_given.z(),
                         shortest_number(std::max(1.0, std::ceil(deg_from_rad(tilt) * 1.2))), shortest_number(std::max(1.0, std::ceil(deg_from_rad(tilt) * 1.2))),
                         is_turned ? std::string("free") : shortest_number(rounded(deg_from_rad(play_turn), 3))));
  std::string step = part.step;
  if (sc.trap == "step_cut") step.resize(step.size() / 2);
  write_text(batch / (sc.part + ".step"), step);
  std::string sheet = fmt::format("asbuilt: part/1\nid: {0}\ncad: {0}.step\nmaterial: '{1}'\n", sc.part, part.material);
  if (sc.trap == "missing_unit") {
    write_stl(batch / (sc.part + ".stl"), part.drawn);
    sheet = fmt::format("asbuilt: part/1\nid: {0}\ncad: {0}.stl\nmaterial: '{1}'\n", sc.part, part.material);
  }
  if (sc.trap == "unknown_key") sheet += "colour: blue\n";
  if (part.axis) sheet += "symmetry:\n  axis: {point: [0, 0, 0], direction: [0, 0, 1]}\n  order: continuous\n";
  sheet += part.burr_zone + "features:\n";
  for (const std::string& f : part.features) {
    std::string near;
    for (const TrueEdge& e : nominal_edges)
      if (e.feature == f) {
        const Vec3 m = e.p[e.p.size() / 2];
        near += fmt::format("{}[{}, {}, {}]", near.empty() ? "" : ", ", shortest_number(rounded(m.x(), 3)), shortest_number(rounded(m.y(), 3)), shortest_number(rounded(m.z(), 3)));
      }
    sheet += fmt::format("- id: {}\n  recipe: {}\n  edges: {{near: [{}]}}\n", f, part.recipe_id, near);
  }
  write_text(batch / "part.yaml", sheet);
  write_text(batch / (part.recipe_id + ".yaml"),
             fmt::format("asbuilt: recipe/1\nid: {}\nprocess: deburr\ntool: {}\nspindle_rpm: 12000\nedge_break: {{width: {}, tolerance: {}}}\n"
                         "feed: {{min: 3, max: 40}}\nremoval: {{max_mm3_s: {}, chip_load_mm: 0.06}}\nburr: {{max_height: {}, max_passes: 3}}\n"
                         "orientation: {{mode: fixed, axis: [0, 0, {}], cone: 30}}\napproach: 25\nlead: 2\npath_tolerance: 0.01\n",
                         part.recipe_id, cell.tools[0].id, shortest_number(part.width_mm), shortest_number(part.tolerance_mm),
                         shortest_number(part.removal_max_mm3_s), shortest_number(part.burr_max_mm), sc.trap == "unreachable" ? 1 : -1));
  write_text(batch / "batch.yaml",
             fmt::format("asbuilt: batch/1\nid: virtual-{}-{}\ncell: cell.yaml\ncalibration: calibration.yaml\nrecipes: [{}.yaml]\nitems:\n"
                         "- {{id: {}, part: part.yaml, fixture: fixture.yaml, scans: {}/scans.yaml}}\n",
                         sc.part, sc.seed, part.recipe_id, item, item));

  // ---- the truth, for the comparison alone
  Json t = Json::object();
  t["item"] = item, t["part"] = sc.part, t["seed"] = sc.seed, t["trap"] = sc.trap;
  t["expect"] = sc.trap.empty() || sc.trap == "nan_points" ? "emit" : "refuse";
  t["base_part"] = to_json(T_base_part);
  t["turn_deg"] = deg_from_rad(turn);
  t["width_mm"] = part.width_mm, t["tolerance_mm"] = part.tolerance_mm;
  t["captures"] = captures_truth;
  t["edges"] = Json::array();
  for (std::size_t i = 0; i < cell.sensors.size(); ++i) t["flange_sensors"][cell.sensors[i].id] = {{"true", to_json(mount_true[i])}, {"given", to_json(mount_given[i])}};
  t["robot_seed"] = sc.seed, t["flange_tool_true"] = to_json(tool_true), t["flange_tool_given"] = to_json(tool_given);
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const TrueEdge& e = edges[i];
    Json p = Json::array(), n1 = Json::array(), n2 = Json::array(), h = Json::array(), w = Json::array(), s = Json::array();
    for (std::size_t k = 0; k < e.p.size(); k += 2) {
      p.push_back(to_json(T_base_part.point(e.p[k])));
      n1.push_back(to_json(T_base_part.direction(e.n_1[k]))), n2.push_back(to_json(T_base_part.direction(e.n_2[k])));
      h.push_back(burrs[i].height_mm[k]), w.push_back(burrs[i].width_mm[k]), s.push_back(e.s_mm[k]);
    }
    t["edges"].push_back({{"id", e.id}, {"feature", e.feature}, {"s", s}, {"p", p}, {"n_1", n1}, {"n_2", n2}, {"burr_height", h}, {"burr_width", w}});
  }
  write_stl(truth / "scene.stl", scene);  // what the sensors saw, in base
  write_text(truth / "truth.json", t.dump() + "\n");
  return Done<std::filesystem::path>{batch / "batch.yaml", {}};
}

}  // namespace asbuilt
