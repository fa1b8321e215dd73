// SPDX-License-Identifier: GPL-3.0-or-later
// The public calibration sets beside the project, written as captures files the way a customer would: one folder a set, captures.yaml in
// it, for `asbuilt calibrate captures.yaml` and for the studies. What the format cannot hold is turned into what it can: two streams of
// poses into matched poses, an arm the project has no constants for into the poses of its flange.
#pragma once

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "planner/base/number.hpp"
#include "planner/calibrate/arm.hpp"
#include "planner/calibrate/streams.hpp"
#include "planner/inputs/table.hpp"
#include "planner/io/zip_file.hpp"

namespace asbuilt::calibration_sets {

namespace fs = std::filesystem;
inline const fs::path kData = "../shared/data/calibration";

inline std::string whole(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::stringstream s;
  s << in.rdbuf();
  return s.str();
}

inline void put(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << text;
}

/// An OpenCV FileStorage text with one list of x, y, z: the numbers as a CSV of x, z.
inline std::string profile_csv(const std::string& yml) {
  std::string csv = "x,z\n", number;
  std::vector<std::string> row;
  const std::size_t begin = yml.find('[');
  for (std::size_t i = begin + 1; i < yml.size(); ++i) {
    const char c = yml[i];
    if (c == ',' || c == ']') {
      row.push_back(number == ".Nan" || number == ".NaN" ? "nan" : number);
      number.clear();
      if (row.size() == 3) csv += row[0] + "," + row[2] + "\n", row.clear();
      if (c == ']') break;
    } else if (!std::isspace(static_cast<unsigned char>(c))) {
      number += c;
    }
  }
  return csv;
}

/// A row of a table of poses: flange and target in sensor, mm and quaternions.
inline std::string pose_row(const Vec3& p, const Eigen::Quaterniond& q, const Vec3& s, const Eigen::Quaterniond& r) {
  std::string out;
  for (const double x : {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z(), s.x(), s.y(), s.z(), r.w(), r.x(), r.y(), r.z()}) out += (out.empty() ? "" : ",") + fixed_number(x, 9);
  return out + "\n";
}
inline const char* kPoseHead = "fx,fy,fz,fqw,fqx,fqy,fqz,sx,sy,sz,sqw,sqx,sqy,sqz\n";
inline const char* kPoseColumns = "poses: {file: poses.csv, xyz: [fx, fy, fz], quat: [fqw, fqx, fqy, fqz], sensor_xyz: [sx, sy, sz], sensor_quat: [sqw, sqx, sqy, sqz]}\n";

// the physical UR10, as the tracker sets need it; the table of two axes
inline std::vector<DhJoint> ur10() { return {{127.3, 0, 0, kPi / 2}, {0, 0, -612, 0}, {0, 0, -572.3, 0}, {163.941, 0, 0, kPi / 2}, {115.7, 0, 0, -kPi / 2}, {92.2, 0, 0, 0}}; }
inline ArmParameters positioner(const ArmRecipe& recipe) {
  return dh_parameters(recipe, {{0, 0, 0, -kPi / 2}, {-475, -kPi / 2, 0, 0}}, Pose<frame::Base, frame::Base>(quat_exp(Vec3(kPi / 2, 0, 0)), Vec3(2200, 0, 1600)));
}

/// Views with joints and the target's pose in the sensor; flanges are still to be computed.
inline std::vector<NetworkView> ur10_views(const fs::path& csv) {
  const inputs::Table t = inputs::parse_table(whole(csv), csv.string());
  const char* names[] = {"shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"};
  const char* measured[] = {"measurement_x", "measurement_y", "measurement_z", "measurement_rx", "measurement_ry", "measurement_rz"};
  std::vector<NetworkView> all;
  for (std::size_t i = 0; i < t.rows.size(); ++i) {
    NetworkView v;
    v.name = "row " + std::to_string(i);
    double m[6];
    bool ok = true;
    for (const char* name : names) {
      const auto x = t.number(i, *t.column(name));
      ok = ok && x && std::isfinite(*x);
      v.joints.push_back(x.value_or(0));
    }
    for (int k = 0; k < 6; ++k) {
      const auto x = t.number(i, *t.column(measured[k]));
      ok = ok && x && std::isfinite(*x);
      m[k] = x.value_or(0);
    }
    if (!ok) continue;
    v.T_sensor_target =
        Pose<frame::Sensor, frame::Target>(quat_exp(Vec3(rad_from_deg(m[3]), 0, 0)) * quat_exp(Vec3(0, rad_from_deg(m[4]), 0)) * quat_exp(Vec3(0, 0, rad_from_deg(m[5]))), Vec3(m[0], m[1], m[2]));
    all.push_back(std::move(v));
  }
  return all;
}

inline std::vector<NetworkView> positioner_views() {
  std::istringstream in(whole(kData / "positioner_2axis" / "measurements.yaml"));
  std::map<std::string, double> p;
  std::vector<double> joints;
  std::vector<NetworkView> out;
  const auto flush = [&]() {
    if (joints.size() == 2) {
      NetworkView v;
      v.name = "row " + std::to_string(out.size());
      v.joints = joints;
      v.T_sensor_target = Pose<frame::Sensor, frame::Target>(Eigen::Quaterniond(p["qw"], p["qx"], p["qy"], p["qz"]).normalized(), 1000 * Vec3(p["x"], p["y"], p["z"]));
      out.push_back(v);
    }
    joints.clear();
  };
  for (std::string line; std::getline(in, line);) {
    if (line[0] == '\'') flush();
    const auto colon = line.find(": ");
    if (line.find("- ") != std::string::npos && colon == std::string::npos) joints.push_back(std::stod(line.substr(line.find("- ") + 2)));
    else if (colon != std::string::npos) p[line.substr(line.find_first_not_of(' '), colon - line.find_first_not_of(' '))] = std::atof(line.c_str() + colon + 2);
  }
  flush();
  return out;
}

/// Two streams of eth_handeye: hand in base, camera in target.
struct EthStreams {
  std::vector<TimedPose> hand, eye;
};
inline EthStreams eth_streams() {
  const std::string zip = whole(kData / "eth_handeye" / "robot_arm_w_color_camera_real.zip");
  const auto stream = [&](const char* end) {
    const auto text = read_zip_entry(zip, end, 1u << 24);
    std::vector<TimedPose> out;
    if (!text) return out;
    const inputs::Table t = inputs::parse_table(*text, end);
    for (std::size_t i = 0; i < t.rows.size(); ++i) {
      double v[8];
      for (std::size_t k = 0; k < 8; ++k) v[k] = t.number(i, k).value_or(NAN);
      out.push_back({v[0], Eigen::Quaterniond(v[7], v[4], v[5], v[6]).normalized(), 1000 * Vec3(v[1], v[2], v[3])});
    }
    std::sort(out.begin(), out.end(), [](const TimedPose& a, const TimedPose& b) { return a.t_s < b.t_s; });
    return out;
  };
  return {stream("hinge.csv"), stream("target_ir.csv")};
}

/// Views where the flange has turned or moved on since the last one.
inline std::vector<NetworkView> eth_views(const EthStreams& s, double offset_s) {
  const MotionStreamRecipe recipe;
  std::vector<NetworkView> out;
  std::optional<TimedPose> last;
  for (const TimedPose& e : s.eye) {
    const auto h = pose_at(s.hand, e.t_s + offset_s, recipe.gap_max_s);
    if (!h || (last && quat_log(last->q.conjugate() * h->q).norm() < 0.1 && (last->p_mm - h->p_mm).norm() < 60)) continue;
    last = h;
    NetworkView v;
    v.name = "t " + std::to_string(e.t_s - s.eye.front().t_s);
    v.T_base_flange = {h->q, h->p_mm};
    v.T_sensor_target = Pose<frame::Target, frame::Sensor>(e.q, e.p_mm).inverse();
    out.push_back(v);
  }
  return out;
}

inline std::string poses_csv(const std::vector<NetworkView>& views) {
  std::string csv = kPoseHead;
  for (const NetworkView& v : views) csv += pose_row(v.T_base_flange.p_mm, v.T_base_flange.q, v.T_sensor_target->p_mm, v.T_sensor_target->q);
  return csv;
}

inline const std::vector<std::string> kSets{"line_laser_sphere80_a", "line_laser_sphere25", "tracker_ur10_B", "tracker_ur10_C", "zivid_eye_to_hand_a", "charuco_static_camera",
                                            "eth_handeye",           "positioner_2axis",    "ur10_B_arm",     "ur10_C_arm"};

/// Writes FOLDER/captures.yaml and what it names; run from the source folder. False where the set is not beside the project.
inline bool write_set(const std::string& set, const fs::path& folder) {
  const bool is_arm = set == "ur10_B_arm" || set == "ur10_C_arm";
  const fs::path from = kData / (is_arm ? "tracker_ur10_" + set.substr(5, 1) : set);
  if (!fs::exists(from)) return false;
  const auto take = [&](const std::string& file, const std::string& as) { put(folder / as, whole(from / file)); };
  const auto captures = [&](const std::string& text) { put(folder / "captures.yaml", "asbuilt: captures/1\ncell: cell.yaml\ntaken: 2026-11-20\n" + text); };
  const std::string balls = "poses: {file: poses.txt, xyz: [1, 2, 3], rpy: [4, 5, 6], profiles: 'p{}.csv'}\n";
  put(folder / "cell.yaml", whole("tests/refuse/base/cell.yaml"));
  put(folder / "meshes/block.stl", whole("tests/refuse/base/meshes/block.stl"));
  if (set == "line_laser_sphere80_a") {
    take("robot_poses_xyzwpr.txt", "poses.txt");
    for (int i = 1; i <= 15; ++i) put(folder / ("p" + std::to_string(i) + ".csv"), profile_csv(whole(from / ("p" + std::to_string(i) + ".yml"))));
    captures("sensor: wide\nnoise: 0.01\nrobot_sd: {position: 0.1, turn: 0.01}\ntarget: {kind: ball, diameter: 80}\n" + balls);
  } else if (set == "line_laser_sphere25") {
    take("robot_poses_xyzwpr.txt", "poses.txt");
    for (int i = 1; i <= 10; ++i) put(folder / ("p" + std::to_string(i) + ".csv"), profile_csv(whole(from / (std::to_string(i) + "_3C_line.yml"))));
    captures("sensor: wide\nnoise: 0.1\nrobot_sd: {position: 0.2, turn: 0.02}\ntarget: {kind: ball, diameter: 25.4}\n" + balls);
  } else if (set == "tracker_ur10_B" || set == "tracker_ur10_C") {
    // as it comes: semicolons, decimal commas, metres beside millimetres
    take("calibration_handeye.csv", "t.csv");
    captures(
        "sensor: tracker\nmount: base\nnoise: 0.03\nnoise_turn: 0.01\ntarget: {kind: pose}\n"
        "poses: {file: t.csv, units: m, xyz: [flange_x, flange_y, flange_z], quat: [flange_qw, flange_qx, flange_qy, flange_qz], sensor_xyz: [measurement_x, measurement_y, measurement_z], "
        "sensor_xyz_turns: [measurement_rx, measurement_ry, measurement_rz]}\n");
  } else if (set == "zivid_eye_to_hand_a") {
    take("corners.csv", "corners.csv"), take("robot_poses.csv", "robot_poses.csv");
    captures(
        "sensor: zivid\nmount: base\nnoise: 0.1\nrobot_sd: {position: 0.3, turn: 0.05}\ntarget: {kind: checkerboard, columns: 9, rows: 7, pitch: 10}\n"
        "poses: {file: robot_poses.csv, name: image, units: m, xyz: [x_m, y_m, z_m], quat: [qw, qx, qy, qz], points: corners.csv}\n");
  } else if (set == "charuco_static_camera") {
    take("corners.csv", "corners.csv");
    std::string poses = "image,x,y,z,qw,qx,qy,qz\n";
    for (int i = 0; i < 16; ++i) {
      std::map<std::string, std::string> v;
      std::istringstream in(whole(from / "poses" / (std::to_string(i) + ".yaml")));
      for (std::string line; std::getline(in, line);)
        if (const auto colon = line.find(": "); colon != std::string::npos) v[line.substr(0, colon)] = line.substr(colon + 2);
      poses += std::to_string(i) + "," + v["x"] + "," + v["y"] + "," + v["z"] + "," + v["qw"] + "," + v["qx"] + "," + v["qy"] + "," + v["qz"] + "\n";
    }
    put(folder / "poses.csv", poses);
    captures(
        "sensor: mako\nmount: base\nnoise: 0.3\ntarget: {kind: charuco, columns: 4, rows: 6, pitch: 36.195, marker: 18.256}\n"
        "poses: {file: poses.csv, name: image, units: m, xyz: [x, y, z], quat: [qw, qx, qy, qz], points: corners.csv}\n"
        "intrinsics: {fx: 1352.02747, fy: 1356.14287, cx: 789.67065, cy: 627.2995}\nintrinsics_free: true\n");
  } else if (set == "eth_handeye") {
    const EthStreams s = eth_streams();
    const auto match = match_streams({}, s.hand, s.eye);
    if (!match) return false;
    put(folder / "poses.csv", poses_csv(eth_views(s, match->offset_s)));
    captures("sensor: wide\nnoise: 3\nnoise_turn: 0.3\nrobot_sd: {position: 3, turn: 0.17}\ntarget: {kind: pose}\n" + std::string(kPoseColumns));
  } else if (set == "positioner_2axis") {
    // the table is the arm, the camera stands: its nominal flange as poses
    std::vector<NetworkView> views = positioner_views();
    const ArmParameters arm = positioner({});
    for (NetworkView& v : views) v.T_base_flange = arm.forward(Eigen::VectorXd::Zero(arm.sd.size()), v.joints);
    put(folder / "poses.csv", poses_csv(views));
    captures("sensor: camera\nmount: base\nnoise: 0.2\nnoise_turn: 0.03\nrobot_sd: {position: 0.2, turn: 0.03}\ntarget: {kind: pose}\n" + std::string(kPoseColumns));
  } else if (is_arm) {
    // 120 rows spread over all; no wrist of this arm has three axes through one point, so a calibration file cannot hold its corrections
    const std::vector<NetworkView> all = ur10_views(from / (set == "ur10_B_arm" ? "measurements_joint_configurations.csv" : "measurements_random_poses.csv"));
    std::vector<NetworkView> views;
    const ArmParameters arm = dh_parameters({}, ur10());
    for (std::size_t i = 0; i < 120; ++i) {
      views.push_back(all[i * all.size() / 120]);
      views.back().T_base_flange = arm.forward(Eigen::VectorXd::Zero(arm.sd.size()), views.back().joints);
    }
    put(folder / "poses.csv", poses_csv(views));
    captures("sensor: tracker\nmount: base\nnoise: 0.03\nnoise_turn: 0.01\nrobot_sd: {position: 0.5, turn: 0.03}\ntarget: {kind: pose}\n" + std::string(kPoseColumns));
  } else {
    return false;
  }
  return true;
}

}  // namespace asbuilt::calibration_sets
