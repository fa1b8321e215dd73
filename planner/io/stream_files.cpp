// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/stream_files.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "planner/io/csv_table.hpp"

namespace asbuilt {
namespace {

int time_column(const CsvTable& t, double& unit) {
  unit = 1;
  if (const int i = t.column({"t", "t_s", "time", "time_s", "timestamp", "timestamp_s"}); i >= 0) return i;
  unit = 1e-3;
  if (const int i = t.column({"t_ms", "time_ms", "timestamp_ms"}); i >= 0) return i;
  unit = 1e-6;
  if (const int i = t.column({"t_us", "time_us", "timestamp_us"}); i >= 0) return i;
  unit = 1e-9;
  return t.column({"t_ns", "time_ns", "timestamp_ns"});
}

tl::unexpected<Refusals> refused(const char* code, const std::string& where, const std::string& message, double measured = 0, double limit = 0,
                                 const char* unit = "") {
  return refuse({.code = code, .where = where, .message = message, .measured = measured, .limit = limit, .unit = unit, .stage = "input"});
}

/// Undoes the lens: normalised image coordinates -> direction ratios, by fixed-point iteration (Brown's model).
Vec2 undistorted(const std::array<double, 5>& k, const Vec2& d) {
  Vec2 n = d;
  for (int i = 0; i < 20; ++i) {
    const double r2 = n.squaredNorm(), radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
    const Vec2 tangential(2 * k[2] * n.x() * n.y() + k[3] * (r2 + 2 * n.x() * n.x()), k[2] * (r2 + 2 * n.y() * n.y()) + 2 * k[3] * n.x() * n.y());
    n = (d - tangential) / radial;
  }
  return n;
}

}  // namespace

Result<CameraFile> read_camera_file(std::string_view bytes, const std::string& name) {
  const nlohmann::json j = nlohmann::json::parse(bytes, nullptr, false);
  if (j.is_discarded() || !j.is_object()) return refused("input.camera_syntax", name, "found no JSON object, allowed the camera's numbers: {\"fx\": .., \"fy\": .., \"cx\": .., \"cy\": ..}");
  CameraFile out;
  std::string problem;
  const auto number = [&](std::initializer_list<const char*> names, double low, double high) -> std::optional<double> {
    for (const char* n : names) {
      const auto it = j.find(n);
      if (it == j.end()) continue;
      const double v = it->is_number() ? it->get<double>() : std::nan("");
      if (!(v >= low && v <= high)) problem = fmt::format("found {} outside {:g} to {:g}, or no number", n, low, high);
      return v;
    }
    return std::nullopt;
  };
  const auto fx = number({"fx"}, 1, 1e6), fy = number({"fy"}, 1, 1e6), cx = number({"cx", "ppx"}, -1e6, 1e6), cy = number({"cy", "ppy"}, -1e6, 1e6);
  if (problem.empty() && (!fx || !fy || !cx || !cy)) problem = "found no fx, fy, cx, cy (px), which are required";
  const auto width = number({"width"}, 1, 100000), height = number({"height"}, 1, 100000);
  const auto unit = number({"depth_unit"}, 1e-6, 1000), scale = number({"depth_scale"}, 1e-9, 1);
  const auto rate = number({"fps"}, 0.001, 1e6), exposure = number({"exposure_ms"}, 0, 1e5);
  DepthCamera& c = out.camera;
  c.fx_px = fx.value_or(0), c.fy_px = fy.value_or(0), c.cx_px = cx.value_or(0), c.cy_px = cy.value_or(0);
  c.width_px = static_cast<int>(width.value_or(0)), c.height_px = static_cast<int>(height.value_or(0));
  if (unit) c.depth_unit_mm = *unit;
  else if (scale) c.depth_unit_mm = 1000 * *scale;
  out.rate_hz = rate;
  out.exposure_s = exposure.value_or(0) / 1000;
  const auto list = [&](const char* n, std::size_t count, bool or_fewer) -> std::optional<std::vector<double>> {
    const auto it = j.find(n);
    if (it == j.end()) return std::nullopt;
    std::vector<double> v;
    if (it->is_array())
      for (const auto& e : *it)
        if (e.is_number() && v.size() <= count) v.push_back(e.get<double>());
    if (!it->is_array() || v.size() != it->size() || v.size() > count || (!or_fewer && v.size() != count)) problem = fmt::format("found {} that is no list of {} numbers", n, count);
    return v;
  };
  for (const char* n : {"distortion", "coeffs"})
    if (const auto v = list(n, 5, true))
      for (std::size_t i = 0; i < v->size() && i < 5; ++i) c.distortion_ratio[i] = (*v)[i];
  for (const double k : c.distortion_ratio)
    if (!(std::abs(k) < 100)) problem = "found a distortion beyond 100";
  if (const auto v = list("plane", 4, false); v && v->size() == 4) {
    const double length = Vec3((*v)[0], (*v)[1], (*v)[2]).norm();
    if (!(length > 1e-9 && length < 1e9)) problem = "found a plane without a normal";
    else out.plane = std::array<double, 4>{(*v)[0] / length, (*v)[1] / length, (*v)[2] / length, (*v)[3] / length};
  }
  if (!problem.empty()) return refused("input.camera_value", name, problem);
  return out;
}

Result<std::vector<FrameTime>> read_frame_times(std::string_view bytes, const std::string& name) {
  const auto t = read_csv_table(bytes, name, "file");
  if (!t) return refuse_all(t.error());
  double unit = 1;
  const int time = time_column(*t, unit), file = t->column({"file"});
  if (time < 0 || file < 0) return refused("input.frames_columns", name, "found no columns file and t (or t_ms, t_us, t_ns), which are required");
  double exposure_unit = 1, brightness_unit = 1;
  int exposure = t->column({"exposure", "exposure_s"});
  if (exposure < 0) exposure = t->column({"exposure_ms"}), exposure_unit = 1e-3;
  if (exposure < 0) exposure = t->column({"exposure_us"}), exposure_unit = 1e-6;
  const int brightness = t->column({"brightness"});
  std::vector<FrameTime> frames;
  for (std::size_t r = 0; r < t->rows_count; ++r) {
    FrameTime f;
    f.file = t->texts[r];
    f.t_s = t->at(r, time) * unit;
    if (!std::isfinite(f.t_s) || std::abs(f.t_s) > 1e12 || (!frames.empty() && f.t_s <= frames.back().t_s))
      return refused("input.frames_clock", name + ", row " + std::to_string(r + 1), "found a time that is no number or not later than the one before, allowed times that ascend");
    if (exposure >= 0 && t->at(r, exposure) > 0) f.exposure_s = t->at(r, exposure) * exposure_unit;
    if (brightness >= 0 && t->at(r, brightness) >= 0) f.brightness_ratio = t->at(r, brightness), brightness_unit = std::max(brightness_unit, f.brightness_ratio > 1 ? 255.0 : 1.0);
    frames.push_back(std::move(f));
  }
  for (FrameTime& f : frames)
    if (f.brightness_ratio >= 0) f.brightness_ratio = std::min(1.0, f.brightness_ratio / brightness_unit);
  return frames;
}

Result<ProfileFile> read_profiles(std::string_view bytes, const std::string& name, const std::optional<CameraFile>& camera, bool keeps_pairs) {
  const auto t = read_csv_table(bytes, name);
  if (!t) return refuse_all(t.error());
  double unit = 1;
  const int time = time_column(*t, unit), x = t->column({"x", "x_mm"}), z = t->column({"z", "z_mm"}), u = t->column({"u", "u_px"}), v = t->column({"v", "v_px"});
  const bool is_metric = x >= 0 && z >= 0, is_pixel = !is_metric && u >= 0 && v >= 0;
  if (time < 0 || (!is_metric && !is_pixel))
    return refused("input.profile_columns", name, "found no columns t and x, z (mm) or u, v (px), one point a row, which are required");
  if (is_pixel && !keeps_pairs && (!camera || !camera->plane))
    return refused("input.profile_camera", name, "found pixels u, v and no camera file with fx, fy, cx, cy and the plane of light; name it in `intrinsics`");
  ProfileFile out;
  out.is_pixel = is_pixel && keeps_pairs;
  for (std::size_t r = 0; r < t->rows_count; ++r) {
    const double when = t->at(r, time) * unit;
    if (!std::isfinite(when) || std::abs(when) > 1e12 || (!out.lines.empty() && when < out.lines.back().t_s))
      return refused("input.profile_clock", name + ", row " + std::to_string(r + 1), "found a time that is no number or earlier than the one before, allowed times that ascend");
    if (out.lines.empty() || when > out.lines.back().t_s) out.lines.push_back({when, out.points.size(), out.points.size()});
    Vec3 p = Vec3::Constant(std::nan(""));
    if (is_metric) {
      p = Vec3(t->at(r, x), 0, t->at(r, z));
    } else if (keeps_pairs) {
      p = Vec3(t->at(r, u), 0, t->at(r, v));
    } else {
      const DepthCamera& c = camera->camera;
      const Vec2 n = undistorted(c.distortion_ratio, Vec2((t->at(r, u) - c.cx_px) / c.fx_px, (t->at(r, v) - c.cy_px) / c.fy_px));
      const auto& w = *camera->plane;
      const double along = w[0] * n.x() + w[1] * n.y() + w[2];
      if (std::abs(along) > 1e-9) p = Vec3(n.x(), n.y(), 1) * (w[3] / along);
    }
    if (!p.allFinite() || p.cwiseAbs().maxCoeff() > 1e6 || p.z() == 0) {
      ++out.dropped_count;
      continue;
    }
    out.points.push_back(p.cast<float>());
    out.lines.back().end = out.points.size();
  }
  if (!out.lines.empty()) out.first_s = out.lines.front().t_s;
  std::erase_if(out.lines, [](const ProfileFile::Line& l) { return l.begin == l.end; });
  if (out.points.empty()) return refused("input.profile_empty", name, "found no valid point, allowed at least one; take the scan again", 0, 1, "points");
  return out;
}

}  // namespace asbuilt
