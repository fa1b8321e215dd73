// SPDX-License-Identifier: GPL-3.0-or-later
// A depth camera on a moving robot: the motion, the log the controller writes of it, and the files of a stream. With the faults that
// such logs have. mm, s, rad.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "planner/simulate/depth_camera.hpp"

namespace asbuilt::simulate_detail {

using BaseFlange = Pose<frame::Base, frame::Flange>;

/// Straight from pose to pose at one speed, with ramps of even acceleration; orientations turn evenly with the way.
class Motion {
 public:
  Motion(std::vector<BaseFlange> poses, double speed_mm_s, double acceleration_mm_s2);
  double duration_s() const { return start_s_.back(); }
  BaseFlange at(double t_s) const;  // held before 0 and after the end

 private:
  std::vector<BaseFlange> poses_;
  std::vector<double> start_s_;
  double speed_, acceleration_;
};
/// Flange poses of a scan over `center_base` with the sensor looking down: to and fro in x and y, tilted, with a dip towards the part.
std::vector<BaseFlange> scan_poses(const Vec3& center_base, double distance_mm, const Vec2& half_mm, double tilt_rad, double dip_mm, const Pose<frame::Flange, frame::Sensor>& T_flange_sensor);

/// What happens to a log on its way.
struct LogFaults {
  std::vector<std::size_t> lost, repeated, late;   // packets by number; late: three cycles
  std::size_t reset_at = 0;                        // the clock starts again here; 0: never
  bool has_decimal_commas = false, has_nul_bytes = false;
  bool hides_losses = false;                       // lost packets leave no step in the clock: it is counted, not read
};
struct LoggedMotion {
  std::vector<double> t_s;                         // robot's clock
  std::vector<BaseFlange> T_base_flange;           // as the controller knows it
  std::vector<double> flash;                       // 0 or 1; empty: no such channel
};
/// The motion as logged every `cycle_s`, from `margin_s` before it begins to as long after it ends; the clock shows start_s at the first.
LoggedMotion log_of(const Motion& motion, double cycle_s, double margin_s, double start_s);
/// KUKA RSI packets of it.
std::string rsi_text(const LoggedMotion& log, const LogFaults& faults);
/// The same with the faults, as a table of poses: t, x, y, z, a, b, c.
std::string csv_text(const LoggedMotion& log, const LogFaults& faults);

/// Images of a motion as a stream in memory: sensor's clock = motion's time + clock_shift_s.
struct SimulatedStream {
  SensorStream stream;
  std::vector<DepthImage> images;                  // parallel to stream.frames
};
struct StreamSettings {
  double rate_hz = 30, exposure_s = 0.005;
  double clock_shift_s = 0;                        // sensor's clock against the motion's time
  double jitter_s = 0;                             // of the frames' stamps, 1 sd
  std::size_t frames_count_max = 100000;           // fewer frames a second where there would be more
  double path_error_mm = 0.03;                     // the arm leaves what it logs by this (slow waves), 1 sd
};
SimulatedStream simulate_stream(const RayScene& scene, const DepthCameraModel& model, const Motion& motion, const Pose<frame::Flange, frame::Sensor>& T_flange_sensor, const StreamSettings& settings,
                                Random& random);
/// folder/NNNN.png and frames.csv; `camera_file`: the camera's numbers as JSON.
void write_frames(const std::filesystem::path& folder, const std::filesystem::path& camera_file, const SimulatedStream& stream);

}  // namespace asbuilt::simulate_detail
