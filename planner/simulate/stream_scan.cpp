// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/simulate/stream_scan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "planner/simulate/files.hpp"

namespace asbuilt::simulate_detail {
namespace {

/// A, B, C in degrees (KUKA).
Vec3 abc_of(const Eigen::Quaterniond& q) {
  const Mat3 m = q.toRotationMatrix();
  return Vec3(std::atan2(m(1, 0), m(0, 0)), std::asin(std::clamp(-m(2, 0), -1.0, 1.0)), std::atan2(m(2, 1), m(2, 2))) * 180.0 / kPi;
}

struct Packet {
  double t_s;
  const BaseFlange* T;
  double flash;
  int delay;
};

std::vector<Packet> packets_of(const LoggedMotion& log, const LogFaults& f) {
  std::vector<Packet> all, late;
  const auto has = [](const std::vector<std::size_t>& list, std::size_t i) { return std::find(list.begin(), list.end(), i) != list.end(); };
  double shift = 0;
  const double cycle = log.t_s.size() > 1 ? log.t_s[1] - log.t_s[0] : 0.004;
  std::vector<std::pair<std::size_t, Packet>> waiting;
  for (std::size_t i = 0; i < log.t_s.size(); ++i) {
    if (f.reset_at > 0 && i == f.reset_at) shift = -log.t_s[i] + 1.0;
    if (has(f.lost, i)) {
      if (f.hides_losses) shift -= cycle;
      continue;
    }
    const Packet p{log.t_s[i] + shift, &log.T_base_flange[i], log.flash.empty() ? 0 : log.flash[i], 0};
    if (has(f.late, i)) waiting.emplace_back(i + 3, p);
    else all.push_back(p);
    if (has(f.repeated, i)) all.push_back(p);
    for (auto it = waiting.begin(); it != waiting.end();) {
      if (it->first == i) {
        it->second.delay = 3;
        all.push_back(it->second);
        it = waiting.erase(it);
      } else {
        ++it;
      }
    }
  }
  return all;
}

}  // namespace

Motion::Motion(std::vector<BaseFlange> poses, double speed_mm_s, double acceleration_mm_s2) : poses_(std::move(poses)), speed_(speed_mm_s), acceleration_(acceleration_mm_s2) {
  start_s_.push_back(0);
  for (std::size_t i = 1; i < poses_.size(); ++i) {
    const double length = (poses_[i].p_mm - poses_[i - 1].p_mm).norm(), ramp = speed_ * speed_ / acceleration_;
    start_s_.push_back(start_s_.back() + (length > ramp ? length / speed_ + speed_ / acceleration_ : 2 * std::sqrt(std::max(1e-6, length) / acceleration_)));
  }
}

BaseFlange Motion::at(double t) const {
  if (t <= 0) return poses_.front();
  if (t >= start_s_.back()) return poses_.back();
  const auto it = std::upper_bound(start_s_.begin(), start_s_.end(), t);
  const auto k = static_cast<std::size_t>(it - start_s_.begin()) - 1;
  const BaseFlange &a = poses_[k], &b = poses_[k + 1];
  const double length = std::max(1e-6, (b.p_mm - a.p_mm).norm()), whole = start_s_[k + 1] - start_s_[k], u = t - start_s_[k];
  const double top = std::min(speed_, acceleration_ * whole / 2), ramp = top / acceleration_;
  double way = 0;
  if (u < ramp) way = acceleration_ * u * u / 2;
  else if (u < whole - ramp) way = top * ramp / 2 + top * (u - ramp);
  else way = length - acceleration_ * (whole - u) * (whole - u) / 2;
  const double s = std::clamp(way / length, 0.0, 1.0);
  return {a.q.slerp(s, b.q).normalized(), a.p_mm + s * (b.p_mm - a.p_mm)};
}

std::vector<BaseFlange> scan_poses(const Vec3& center, double distance, const Vec2& half, double tilt, double dip, const Pose<frame::Flange, frame::Sensor>& X) {
  std::vector<BaseFlange> poses;
  const auto add = [&](double x, double y, double lift, double tilt_x, double tilt_y) {
    // seen from the side by the tilts, always towards the point below
    const Eigen::Quaterniond lean = quat_exp(Vec3(tilt_x, tilt_y, 0));
    const Vec3 target = center + Vec3(x, y, 0), z = -(lean * Vec3::UnitZ());
    const Pose<frame::Base, frame::Sensor> T(quat_from_z(z, Vec3::UnitX()), target - z * (distance + lift));
    poses.push_back(T * X.inverse());
  };
  add(0, 0, dip, 0, 0), add(0, 0, 0, 0, 0), add(0, 0, dip, 0, 0), add(0, 0, 0, 0, 0);  // towards the part and back: scale and clock
  for (const double sign : {-1.0, 1.0}) {
    add(-half.x(), sign * half.y(), 0, 0, sign * tilt), add(half.x(), sign * half.y(), 0, 0, -sign * tilt);
    add(half.x() * 0.3, 0, 0, sign * tilt, 0), add(-half.x() * 0.3, sign * half.y(), 0, -sign * tilt, 0);
  }
  add(0, 0, 0, 0, 0);
  return poses;
}

LoggedMotion log_of(const Motion& motion, double cycle, double margin, double start) {
  LoggedMotion log;
  const auto count = static_cast<std::size_t>((motion.duration_s() + 2 * margin) / cycle) + 1;
  for (std::size_t i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) * cycle;
    log.t_s.push_back(start + t), log.T_base_flange.push_back(motion.at(t - margin));
  }
  return log;
}

std::string rsi_text(const LoggedMotion& log, const LogFaults& faults) {
  std::string out;
  std::size_t number = 0;
  for (const Packet& p : packets_of(log, faults)) {
    const Vec3 abc = abc_of(p.T->q), x = p.T->p_mm;
    std::string line = fmt::format(R"(<Rob Type="KUKA"><RIst X="{:.4f}" Y="{:.4f}" Z="{:.4f}" A="{:.6f}" B="{:.6f}" C="{:.6f}"/>)", x.x(), x.y(), x.z(), abc.x(), abc.y(), abc.z());
    if (!log.flash.empty()) line += fmt::format("<FLASH>{}</FLASH>", p.flash > 0.5 ? 1 : 0);
    if (faults.has_decimal_commas) std::replace(line.begin(), line.end(), '.', ',');
    line += fmt::format(R"(<Delay D="{}"/><IPOC>{}</IPOC></Rob>)", p.delay, std::llround(1000 * p.t_s)) + "\n";
    if (faults.has_nul_bytes && number % 50 == 7) line.insert(line.size() / 2, 1, '\0');
    out += line, ++number;
  }
  return out;
}

std::string csv_text(const LoggedMotion& log, const LogFaults& faults) {
  const bool comma = faults.has_decimal_commas;
  std::string out = log.flash.empty() ? "t_s;x;y;z;a;b;c\n" : "t_s;x;y;z;a;b;c;FLASH\n";
  for (const Packet& p : packets_of(log, faults)) {
    const Vec3 abc = abc_of(p.T->q), x = p.T->p_mm;
    std::string line = fmt::format("{:.6f};{:.4f};{:.4f};{:.4f};{:.6f};{:.6f};{:.6f}", p.t_s, x.x(), x.y(), x.z(), abc.x(), abc.y(), abc.z());
    if (!log.flash.empty()) line += p.flash > 0.5 ? ";1" : ";0";
    if (comma) std::replace(line.begin(), line.end(), '.', ',');
    out += line + "\n";
  }
  return out;
}

SimulatedStream simulate_stream(const RayScene& scene, const DepthCameraModel& model, const Motion& motion, const Pose<frame::Flange, frame::Sensor>& X, const StreamSettings& s, Random& random) {
  SimulatedStream out;
  out.stream.camera = model.camera;
  const double rate = std::min(s.rate_hz, static_cast<double>(s.frames_count_max) / motion.duration_s());
  const auto count = static_cast<std::size_t>(motion.duration_s() * rate);
  double wave[6];
  for (double& w : wave) w = random.uniform(0, 2 * kPi);
  for (std::size_t i = 0; i < count; ++i) {
    const double t = (static_cast<double>(i) + 0.5) / rate;
    BaseFlange T = motion.at(t);
    for (int k = 0; k < 3; ++k) T.p_mm[k] += s.path_error_mm * (std::sin(2 * kPi * 0.35 * t + wave[k]) + 0.5 * std::sin(2 * kPi * 1.1 * t + wave[k + 3])) * 1.26;
    Random own = Random::stream(random.below(1u << 30), "frame");
    out.images.push_back(depth_image(scene, model, T * X, own));
    StreamFrame f;
    f.file = fmt::format("{:05}.png", i), f.t_s = t + s.clock_shift_s + s.jitter_s * own.normal(), f.exposure_s = s.exposure_s;
    out.stream.frames.push_back(std::move(f));
  }
  return out;
}

void write_frames(const std::filesystem::path& folder, const std::filesystem::path& camera_file, const SimulatedStream& s) {
  bool has_brightness = false;
  for (const StreamFrame& f : s.stream.frames) has_brightness = has_brightness || f.brightness_ratio >= 0;
  std::string table = has_brightness ? "file,t,exposure_ms,brightness\n" : "file,t,exposure_ms\n";
  for (std::size_t i = 0; i < s.images.size(); ++i) {
    const StreamFrame& f = s.stream.frames[i];
    write_text(folder / f.file, write_depth_png(s.images[i]));
    table += fmt::format("{},{:.6f},{:.3f}", f.file, f.t_s, 1000 * f.exposure_s) + (has_brightness ? fmt::format(",{:.4f}", f.brightness_ratio) : "") + "\n";
  }
  write_text(folder / "frames.csv", table);
  const DepthCamera& c = *s.stream.camera;
  write_text(camera_file, fmt::format("{{\"fx\": {:.6f}, \"fy\": {:.6f}, \"cx\": {:.6f}, \"cy\": {:.6f}, \"width\": {}, \"height\": {}, \"depth_unit\": {:.6f}}}\n", c.fx_px, c.fy_px, c.cx_px, c.cy_px,
                                      c.width_px, c.height_px, c.depth_unit_mm));
}

}  // namespace asbuilt::simulate_detail
