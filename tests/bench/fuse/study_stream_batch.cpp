// SPDX-License-Identifier: GPL-3.0-or-later
// study_stream_batch DIR [PART [SEED [SPEED]]]: a virtual batch whose wide views are taken away and replaced by one stream of a low-cost
// depth camera on the moving, imperfect robot: DIR/batch (for `asbuilt batch`) and DIR/truth. The camera's clock is 9 ms off, three packets
// of the log are lost, one comes twice.
// study_stream_batch compare OUT/ITEM DIR/truth: how far a finished run is from the truth.
#include <fmt/format.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "planner/base/archive.hpp"
#include "planner/base/random.hpp"
#include "planner/geom/mesh_query.hpp"
#include "planner/inputs/inputs.hpp"
#include "planner/io/file.hpp"
#include "planner/io/mesh_file.hpp"
#include "planner/simulate/files.hpp"
#include "planner/simulate/simulate.hpp"
#include "planner/simulate/stream_scan.hpp"

using namespace asbuilt;
using namespace asbuilt::simulate_detail;

namespace {

template <class A, class B>
Pose<A, B> pose_of(const Json& j) {
  const Json &q = j["quat"], &p = j["xyz"];
  return {Eigen::Quaterniond(q[0].get<double>(), q[1].get<double>(), q[2].get<double>(), q[3].get<double>()), Vec3(p[0].get<double>(), p[1].get<double>(), p[2].get<double>())};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) return std::printf("study_stream_batch DIR [PART [SEED [SPEED mm/s]]] | compare OUT/ITEM DIR/truth\n"), 2;
  if (argc == 4 && std::string(argv[1]) == "compare") {
    const auto found = compare_with_truth(argv[2], argv[3]);
    if (!found) return std::printf("%s\n", found.error().front().message.c_str()), 1;
    for (const auto& [name, value] : found->artefact) fmt::print("{} {:.4f}\n", name, value);
    return 0;
  }
  const std::filesystem::path dir = argv[1];
  Scenario scenario;
  scenario.part = argc > 2 ? argv[2] : "bracket", scenario.seed = argc > 3 ? std::strtoull(argv[3], nullptr, 10) : 1;
  const double speed_mm_s = argc > 4 ? std::atof(argv[4]) : 50;
  const auto made = simulate(scenario, dir);
  if (!made) return std::printf("%s\n", made.error().front().message.c_str()), 1;
  const auto batch = dir / "batch", truth_folder = dir / "truth";
  const Json truth = Json::parse(*read_file(truth_folder / "truth.json", "truth"));
  const std::string item = truth["item"];
  const auto mesh = read_mesh(*read_file(truth_folder / "scene.stl", "scene"), "scene.stl", 1);
  const auto cell = load_cell(batch / "cell.yaml", {true, "2026-11-22"});
  if (!mesh || !cell) return std::printf("the batch cannot be read back\n"), 1;
  const MeshQuery query(mesh->mesh);
  Random random = Random::stream(scenario.seed, "stream");

  // the camera: on the flange beside the wide sensor, calibrated to 0.05 mm
  DepthCameraModel camera = stereo_camera(424, 240);
  camera.camera.fx_px = camera.camera.fy_px = 330, camera.range_max_mm = 500;
  const Pose<frame::Flange, frame::Sensor> nominal(Eigen::Quaterniond(Eigen::AngleAxisd(0.4, Vec3(0.1, -0.2, 1).normalized())), Vec3(70, -60, 60));
  const auto off = [&](const auto& T, double mm, double rad) {
    Vec6 xi;
    for (int i = 0; i < 6; ++i) xi[i] = random.normal(0, i < 3 ? mm : rad);
    return T.disturbed(xi);
  };
  const auto real = off(nominal, 0.4, 0.003), given = off(real, 0.05, 1e-4);

  // where the arm really is: its error at the wide views, the same over the whole scan (what changes on the way is simulated as waves)
  const auto wide = truth["flange_sensors"]["wide"];
  const auto wide_true = pose_of<frame::Flange, frame::Sensor>(wide["true"]), wide_given = pose_of<frame::Flange, frame::Sensor>(wide["given"]);
  Vec3 arm = Vec3::Zero();
  double count = 0;
  for (const Json& c : truth["captures"])
    if (std::string(c["cloud"]).rfind("wide", 0) == 0) {
      const auto T_true = pose_of<frame::Base, frame::Sensor>(c["base_sensor_true"]) * wide_true.inverse(), T_told = pose_of<frame::Base, frame::Sensor>(c["base_sensor_given"]) * wide_given.inverse();
      arm += T_true.p_mm - T_told.p_mm, ++count;
    }
  arm /= std::max(1.0, count);

  // over the part
  Vec3 lo = Vec3::Constant(1e300), hi = -lo;
  for (const Json& e : truth["edges"])
    for (const Json& p : e["p"]) {
      const Vec3 v(p[0].get<double>(), p[1].get<double>(), p[2].get<double>());
      lo = lo.cwiseMin(v), hi = hi.cwiseMax(v);
    }
  const Vec3 middle = 0.5 * (lo + hi);
  const Vec2 half = (0.5 * (hi - lo).head<2>()).cwiseMax(Vec2(30, 30));
  const double distance = 260;
  const std::vector<BaseFlange> told = scan_poses(middle, distance, half, 0.55, 60, given);
  std::vector<BaseFlange> actual = told;
  for (BaseFlange& T : actual) T.p_mm += arm;
  const Motion motion_told(told, speed_mm_s, 800), motion(actual, speed_mm_s, 800);
  StreamSettings settings;
  settings.clock_shift_s = 0, settings.frames_count_max = 260, settings.jitter_s = 2e-4;
  const SimulatedStream stream = simulate_stream(scene_of(query), camera, motion, real, settings, random);
  write_frames(batch / item / "depth", batch / item / "d405.json", stream);
  const LoggedMotion log = log_of(motion_told, 0.004, 1.0, 0.009 - 1.0 + 10);
  LogFaults faults;
  faults.lost = {800, 801, 802}, faults.repeated = {1200};
  write_text(batch / item / "rsi.xml", rsi_text(log, faults));
  // the sensor's clock shows the same times but for 9 ms: write its stamps 10 s on
  std::string table = *read_file(batch / item / "depth/frames.csv", "frames"), moved;
  std::istringstream lines(table);
  bool is_head = true;
  for (std::string line; std::getline(lines, line); is_head = false) {
    if (is_head) {
      moved += line + "\n";
      continue;
    }
    const auto a = line.find(','), b = line.find(',', a + 1);
    moved += line.substr(0, a + 1) + fmt::format("{:.6f}", std::stod(line.substr(a + 1, b - a - 1)) + 10) + line.substr(b) + "\n";
  }
  write_text(batch / item / "depth/frames.csv", moved);

  // the files: a third sensor, and the stream in place of the wide views
  const auto insert = [&](const char* file, const std::string& after, const std::string& text) {
    std::string t = *read_file(batch / file, file);
    t.insert(t.find(after) + after.size(), text);
    write_text(batch / file, t);
  };
  insert("cell.yaml", "\nsensors:\n", fmt::format("- id: d405\n  kind: depth_stream\n  flange_sensor: {}\n  range: [70, 500]\n  working_distance: {}\n  field_of_view: [330, 190]\n  noise: {:.3f}\n", pose_text(nominal),
                                                  distance, distance * distance / (330 * camera.baseline_mm) * camera.disparity_sd_px));
  insert("calibration.yaml", "\nsensors:\n",
         fmt::format("  d405:\n    flange_sensor: {}\n    covariance: [[0.0025, 0, 0, 0, 0, 0], [0, 0.0025, 0, 0, 0, 0], [0, 0, 0.0025, 0, 0, 0], [0, 0, 0, 1.0e-8, 0, 0], [0, 0, 0, 0, 1.0e-8, 0], [0, 0, 0, 0, 0, 1.0e-8]]\n", pose_text(given)));
  std::string scans = *read_file(batch / item / "scans.yaml", "scans"), kept;
  const auto first = scans.find("- sensor:");
  kept = scans.substr(0, first) + "- sensor: d405\n  frames: depth/\n  intrinsics: d405.json\n  robot_log: rsi.xml\n";
  for (std::size_t at = first; at != std::string::npos && at < scans.size();) {
    const std::size_t next = scans.find("- sensor:", at + 1);
    const std::string one = scans.substr(at, next == std::string::npos ? std::string::npos : next - at);
    if (one.rfind("- sensor: wide", 0) != 0) kept += one;
    at = next;
  }
  write_text(batch / item / "scans.yaml", kept);
  fmt::print("{}: {} images at {} mm/s, {} packets, clock 9 ms off, 3 packets lost; arm off by {:.2f} mm\nasbuilt batch {} --out OUT\n", item, stream.images.size(), speed_mm_s, log.t_s.size(), arm.norm(), (batch / "batch.yaml").string());
  return 0;
}
