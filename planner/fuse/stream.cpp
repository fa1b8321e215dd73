// SPDX-License-Identifier: GPL-3.0-or-later
// A stream, from its clock to the points of its views.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/fuse/cells.hpp"
#include "planner/fuse/clock.hpp"
#include "planner/fuse/depth_frame.hpp"
#include "planner/fuse/motion_pairs.hpp"
#include "planner/fuse/streams.hpp"

namespace asbuilt {
namespace {

using namespace fuse_detail;
using BaseSensor = Pose<frame::Base, frame::Sensor>;

constexpr double kFormRatio = 0.25;       // of a sensor's noise that no averaging removes (form of the measuring field)
constexpr int kGridColumns = 64;          // of the frames from which the clock is told
constexpr std::size_t kTogether = 4;      // frames at a time
constexpr double kClockFloor_s = 1e-4;    // no clock is known better

std::string ms(double s) { return fixed_number(1000 * s, 2) + " ms"; }

struct Clock {
  double offset_s = 0, sigma_s = 0;
};

class StreamFusion {
 public:
  StreamFusion(const StreamRecipe& recipe, const Capture& capture, const SensorSpec& sensor, const FrameSource& source)
      : recipe_(recipe), capture_(capture), sensor_(sensor), source_(source), stream_(*capture.stream), robot_(stream_.robot, recipe.gap_max_s) {
    for (std::size_t i = 0; i < stream_.frames.size(); ++i) order_.push_back(i);
    std::sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) { return stream_.frames[a].t_s < stream_.frames[b].t_s; });
    if (stream_.camera) rays_.emplace(*stream_.camera);
    limit_mm_ = std::max(recipe.motion_error_max_mm, recipe.motion_error_noise_ratio * sensor.noise_mm);
  }

  Result<Done<FusedStream>> run() {
    StreamSummary& s = out_.artefact.summary;
    s.name = capture_.name;
    s.frames_count = static_cast<int>(stream_.frames.size());
    s.lost_count = robot_.lost_count(), s.late_count = stream_.robot.late_count, s.repeated_count = stream_.robot.repeated_count, s.reset_count = stream_.robot.reset_count;
    s.gap_max_s = robot_.gap_widest_s(), s.speed_max_mm_s = robot_.speed_max_mm_s();
    if (!find_clock() || !place() || !accumulate()) return refuse_all(std::move(refusals_));
    return std::move(out_);
  }

 private:
  const StreamRecipe& recipe_;
  const Capture& capture_;
  const SensorSpec& sensor_;
  const FrameSource& source_;
  const SensorStream& stream_;
  Trajectory robot_;
  std::vector<std::size_t> order_;  // frames by time
  std::optional<CameraRays> rays_;
  double limit_mm_ = 0;
  Clock clock_;
  Refusals refusals_;
  Done<FusedStream> out_;

  struct Placed {
    std::size_t frame = 0;
    PoseAt at;
    BaseSensor T_base_sensor;
    int view = 0;
  };
  std::vector<Placed> placed_;

  bool refuse_it(const char* code, const std::string& message, double measured, double limit, const char* unit) {
    refusals_.push_back({.code = code, .where = "capture " + capture_.name, .message = message, .measured = measured, .limit = limit, .unit = unit, .stage = "fuse"});
    return false;
  }
  void note(Note::Level level, const char* code, const std::string& text) { out_.notes.push_back({level, code, text, capture_.name}); }

  /// Reads frames in parallel and hands each to `use`; the first refusal (in the order of the list) is kept.
  template <class Use>
  bool with_frames(const std::vector<std::size_t>& frames, const Use& use) {
    std::vector<Refusals> refused(frames.size());
    tbb::parallel_for(std::size_t{0}, frames.size(), [&](std::size_t i) {
      auto image = source_(stream_.frames[frames[i]]);
      if (!image) refused[i] = image.error();
      else use(i, *image);
    });
    for (Refusals& r : refused)
      if (!r.empty()) {
        refusals_ = std::move(r);
        return false;
      }
    return true;
  }

  double t(std::size_t k) const { return stream_.frames[order_[k]].t_s; }

  // ---------------------------------------------------------------- clock
  /// Equations of up to pairs_count pairs, `apart_s` between the two frames; started from the robot's motion at `offset_s`, or from rest.
  bool pairs_of(double apart_s, std::optional<double> offset_s, std::vector<MotionPair>& pairs) {
    std::vector<std::pair<std::size_t, std::size_t>> chosen;
    const std::size_t count = order_.size();
    const double spacing = (t(count - 1) - t(0)) / static_cast<double>(std::max<std::size_t>(1, count - 1));
    for (std::size_t k = 0; k + 1 < count; ++k) {
      std::size_t m = k + 1;
      while (m < count && t(m) < t(k) + apart_s) ++m;
      if (m < count && t(m) - t(k) < 3 * apart_s + 2.5 * spacing) chosen.emplace_back(k, m);
    }
    const std::size_t wanted = static_cast<std::size_t>(std::max(8, recipe_.pairs_count));
    if (chosen.size() > wanted) {
      std::vector<std::pair<std::size_t, std::size_t>> fewer;
      for (std::size_t i = 0; i < wanted; ++i) fewer.push_back(chosen[(2 * i + 1) * chosen.size() / (2 * wanted)]);
      chosen.swap(fewer);
    }
    if (offset_s) add_deep_pairs(*offset_s, chosen);
    pairs.assign(chosen.size(), {});
    const int stride = (stream_.camera->width_px + kGridColumns - 1) / kGridColumns;
    const double sigma = std::max(1e-4, sensor_.noise_mm);
    constexpr std::size_t chunk = 8;
    for (std::size_t begin = 0; begin < chosen.size(); begin += chunk) {
      const std::size_t n = std::min(chunk, chosen.size() - begin);
      std::vector<std::size_t> frames;
      for (std::size_t i = 0; i < n; ++i) frames.push_back(order_[chosen[begin + i].first]), frames.push_back(order_[chosen[begin + i].second]);
      std::vector<DepthFrame> grid(frames.size());
      if (!with_frames(frames, [&](std::size_t i, const DepthPixels& image) { grid[i] = frame_of(image, *rays_, sensor_, {}, stride); })) return false;
      tbb::parallel_for(std::size_t{0}, n, [&](std::size_t i) {
        const double first = t(chosen[begin + i].first), second = t(chosen[begin + i].second);
        Eigen::Isometry3d start = Eigen::Isometry3d::Identity();
        if (offset_s) {
          const PoseAt a = robot_.at(first + *offset_s), b = robot_.at(second + *offset_s);
          if (!a.is_known || !b.is_known) return;
          start = ((a.T_base_flange * sensor_.T_flange_sensor).inverse() * (b.T_base_flange * sensor_.T_flange_sensor)).matrix();
        }
        MotionPair& pair = pairs[begin + i];
        pair = motion_pair(grid[2 * i], grid[2 * i + 1], *rays_, sigma, start);
        pair.t_first_s = first, pair.t_second_s = second;
      });
    }
    return true;
  }

  /// Pairs between which the sensor moved along its own axis and little else: what tells the scale of its depths (B2.5).
  void add_deep_pairs(double offset_s, std::vector<std::pair<std::size_t, std::size_t>>& chosen) {
    struct Deep {
      double depth_mm;
      std::size_t i, j;
    };
    std::vector<std::pair<std::size_t, BaseSensor>> places;
    const std::size_t step = 1 + order_.size() / 150;
    for (std::size_t k = 0; k < order_.size(); k += step)
      if (const PoseAt at = robot_.at(t(k) + offset_s); at.is_known) places.emplace_back(k, at.T_base_flange * sensor_.T_flange_sensor);
    std::vector<Deep> deep;
    for (std::size_t a = 0; a < places.size(); ++a) {
      Deep best{0, 0, 0};
      for (std::size_t b = 0; b < places.size(); ++b) {
        const Vec3 d = places[a].second.q.conjugate() * (places[b].second.p_mm - places[a].second.p_mm);
        if (d.z() < 10 || d.z() < best.depth_mm || d.head<2>().norm() > 0.25 * sensor_.working_distance_mm || places[a].second.q.angularDistance(places[b].second.q) > 0.26) continue;
        best = {d.z(), places[a].first, places[b].first};
      }
      if (best.depth_mm > 0) deep.push_back(best);
    }
    std::stable_sort(deep.begin(), deep.end(), [](const Deep& a, const Deep& b) { return a.depth_mm > b.depth_mm; });
    for (std::size_t k = 0; k < std::min<std::size_t>(30, deep.size()); ++k) chosen.emplace_back(deep[k].i, deep[k].j);
  }

  bool find_clock() {
    const ClockSpec& spec = stream_.clock;
    StreamSummary& s = out_.artefact.summary;
    std::optional<OffsetInterval> flash;
    if (spec.uses_flash) {
      flash = flash_offset(stream_.frames, stream_.robot.flash_s);
      const std::size_t bright = bright_frames(stream_.frames).size();
      if (!flash)
        return refuse_it("fuse.flash_not_seen",
                         "The log shows " + std::to_string(stream_.robot.flash_s.size()) + " flashes, the frames " + std::to_string(bright) +
                             ", and no offset makes them the same; flash once or more while the sensor looks at the part, and write the brightness of every frame.",
                         static_cast<double>(bright), static_cast<double>(std::max<std::size_t>(1, stream_.robot.flash_s.size())), "flashes");
      s.flash_count = flash->flash_count, s.flash_offset_s = {flash->low_s, flash->high_s};
    }
    std::optional<double> start;
    if (flash) start = flash->middle_s();
    else if (spec.is_common) start = spec.offset_s;

    std::optional<MotionOffset> motion;
    if (rays_) {
      std::vector<MotionPair> pairs;
      if (!start) {
        if (!pairs_of(1e-3, std::nullopt, pairs)) return false;
        const double low = robot_.begin_s() - t(0), high = robot_.end_s() - t(order_.size() - 1), slack = 0.5 * (t(order_.size() - 1) - t(0));
        const auto found = search_offset(pairs, robot_, sensor_.T_flange_sensor, std::min(low, high) - slack, std::max(low, high) + slack, 0.004);
        if (!found)
          return refuse_it("fuse.clock_not_seen", "The frames and the robot's log have no motion in common by which their clocks could be matched; flash once, or move to and fro for two seconds.", 0, 5, "pairs");
        if (found->second_ratio > 0.8)
          return refuse_it("fuse.clock_ambiguous", "Two offsets between the clocks explain the motion nearly equally well (" + fixed_number(100 * found->second_ratio, 0) + " % of the best); flash once, or move unevenly.",
                           found->second_ratio, 0.8, "");
        start = found->offset_s;
      }
      double at = *start;
      for (int pass = 0; pass < 4; ++pass) {  // again around what was found, until it stays
        if (!pairs_of(recipe_.pair_time_s, at, pairs)) return false;
        motion = solve_offset(pairs, robot_, sensor_.T_flange_sensor, at, true);
        if (!motion) break;
        const double moved = std::abs(motion->offset_s - at);
        if (std::abs(motion->offset_s - *start) > 1.0) {
          motion.reset();
          break;
        }
        at = motion->offset_s;
        if (moved < std::max(2e-4, 0.5 * motion->sigma_s)) break;
      }
    }
    if (motion) {
      motion->sigma_s = std::hypot(motion->sigma_s, kClockFloor_s);
      s.motion_offset_s = motion->offset_s, s.motion_sigma_s = motion->sigma_s;
      s.scale_ratio = motion->scale_ratio, s.scale_sigma_ratio = motion->scale_sigma_ratio;
    }
    if (!combine(flash, motion)) return false;
    s.offset_s = clock_.offset_s, s.offset_sigma_s = clock_.sigma_s;
    return !motion || check_motion(*motion);
  }

  bool combine(const std::optional<OffsetInterval>& flash, const std::optional<MotionOffset>& motion) {
    const ClockSpec& spec = stream_.clock;
    const double speed = robot_.speed_max_mm_s();
    if (flash) {
      clock_ = {flash->middle_s(), flash->sigma_s()};
      if (motion) {
        const double outside = std::max({0.0, flash->low_s - motion->offset_s, motion->offset_s - flash->high_s});
        if (outside > recipe_.agree_sigma_ratio * motion->sigma_s + 1e-4)
          return refuse_it("fuse.clocks_disagree",
                           "The flash puts the offset of the clocks between " + ms(flash->low_s) + " and " + ms(flash->high_s) + ", the motion at " + ms(motion->offset_s) + " +- " + ms(motion->sigma_s) +
                               ": " + ms(outside) + " apart. Packets or frames are missing that nobody counted; scan again.",
                           1000 * outside, 1000 * (recipe_.agree_sigma_ratio * motion->sigma_s + 1e-4), "ms");
        if (motion->sigma_s < clock_.sigma_s) clock_ = {std::clamp(motion->offset_s, flash->low_s, flash->high_s), motion->sigma_s};
      }
    } else if (spec.is_common) {
      clock_ = {spec.offset_s, std::max(1e-6, spec.sigma_s)};
      if (motion) {
        const double apart = motion->offset_s - spec.offset_s;
        const bool is_real = std::abs(apart) > std::max(recipe_.offset_quiet_s, 3 * std::hypot(motion->sigma_s, spec.sigma_s)) && std::abs(apart) > 5 * motion->sigma_s;
        if (is_real && std::abs(apart) > recipe_.offset_max_s)
          return refuse_it("fuse.clock_offset",
                           "The motion says that the robot's clock is " + ms(apart) + " +- " + ms(motion->sigma_s) + " from where it was said to be; at most " + ms(recipe_.offset_max_s) +
                               " are corrected. Find out why, or state `clocks: separate`.",
                           1000 * std::abs(apart), 1000 * recipe_.offset_max_s, "ms");
        if (is_real) {
          clock_ = {motion->offset_s, motion->sigma_s};
          note(Note::Level::warning, "fuse.clock_corrected", "The robot's clock is " + ms(apart) + " +- " + ms(motion->sigma_s) + " from where it was said to be; corrected by the motion.");
        } else {
          const double a = 1 / (clock_.sigma_s * clock_.sigma_s), b = 1 / (motion->sigma_s * motion->sigma_s);
          clock_ = {(a * clock_.offset_s + b * motion->offset_s) / (a + b), 1 / std::sqrt(a + b)};
        }
      } else {
        note(Note::Level::warning, "fuse.clock_not_checked", "The clocks are said to be one, which nothing in the stream could check; " + ms(clock_.sigma_s) + " (1 sd) are allowed for.");
      }
    } else {
      if (!motion)
        return refuse_it("fuse.clock_not_seen", "The motion does not tell the offset of the clocks, and there was no flash; flash once, or move to and fro for two seconds.", 0, 5, "pairs");
      clock_ = {motion->offset_s, motion->sigma_s};
    }
    const double error = clock_.sigma_s * speed;
    if (error > limit_mm_)
      return refuse_it("fuse.clock_not_seen",
                       "The offset of the clocks is known to " + ms(clock_.sigma_s) + " (1 sd), which at " + fixed_number(speed, 1) + " mm/s is " + fixed_number(error, 3) + " mm; at most " +
                           fixed_number(limit_mm_, 3) + " mm are allowed. Flash more often, move to and fro for two seconds, or scan slower.",
                       error, limit_mm_, "mm");
    return true;
  }

  bool check_motion(const MotionOffset& m) {
    for (const auto& w : m.windows) {
      const double apart = std::abs(w.offset_s - m.offset_s), sigma = std::hypot(w.sigma_s, m.sigma_s);
      if (apart > recipe_.jump_max_s && apart > 6 * sigma && w.sigma_s < 0.5 * recipe_.jump_max_s)
        return refuse_it("fuse.clock_jump",
                         "Around " + fixed_number(w.t_s, 2) + " s of the sensor's clock the offset is " + ms(w.offset_s) + " +- " + ms(w.sigma_s) + ", over the whole stream " + ms(m.offset_s) +
                             ": packets or frames are missing that their clocks do not show. Scan again with the packets' own clock in the log.",
                         1000 * apart, 1000 * recipe_.jump_max_s, "ms");
    }
    const double scale = std::abs(m.scale_ratio - 1);
    if (m.scale_sigma_ratio >= 0 && scale > recipe_.scale_max_ratio && scale > 4 * m.scale_sigma_ratio)
      return refuse_it("fuse.depth_scale",
                       "Against the robot's own motion the sensor's depths are to be multiplied by " + fixed_number(m.scale_ratio, 5) + " +- " + fixed_number(m.scale_sigma_ratio, 5) +
                           "; at most " + fixed_number(100 * recipe_.scale_max_ratio, 1) + " % are allowed. Calibrate the sensor; if three such checks agree, set its depth unit to " +
                           fixed_number(m.scale_ratio * (stream_.camera ? stream_.camera->depth_unit_mm : 1), 6) + " mm.",
                       100 * scale, 100 * recipe_.scale_max_ratio, "%");
    if (m.scale_sigma_ratio < 0 || m.scale_sigma_ratio > recipe_.scale_max_ratio / 2)
      note(Note::Level::note, "fuse.scale_not_seen", "The motion does not tell the scale of the sensor's depths well enough (move 100 mm towards the part once to have it checked).");
    const double limit = recipe_.contradiction_noise_ratio * std::max(sensor_.noise_mm, m.scatter_mm);
    if (m.misfit_mm > limit)
      return refuse_it("fuse.stream_contradicts",
                       "Placed by the robot's log, pairs of frames disagree by " + fixed_number(m.misfit_mm, 3) + " mm (median) beyond their own scatter; at most " + fixed_number(limit, 3) +
                           " mm are allowed. The log, the sensor's calibration or the active tool is not the one of this scan.",
                       m.misfit_mm, limit, "mm");
    return true;
  }

  // ---------------------------------------------------------------- places
  bool place() {
    StreamSummary& s = out_.artefact.summary;
    std::size_t outside = 0, in_gaps = 0;
    double gap_at = 0, bridged = 0;
    for (const std::size_t f : order_) {
      const double when = stream_.frames[f].t_s + clock_.offset_s;
      const PoseAt at = robot_.at(when);
      if (when < robot_.begin_s() || when > robot_.end_s()) {
        ++outside;
      } else if (!at.is_known || at.sigma_mm > 2 * limit_mm_) {
        if (in_gaps++ == 0) gap_at = when;
      } else {
        placed_.push_back({f, at, at.T_base_flange * sensor_.T_flange_sensor, 0});
        if (at.gap_s > 1.5 * stream_.robot.cycle_s) bridged = std::max(bridged, at.sigma_mm);
        s.interpolation_sigma_mm = std::max(s.interpolation_sigma_mm, at.sigma_mm);
      }
    }
    s.frames_cut_count = static_cast<int>(outside + in_gaps);
    const double count = static_cast<double>(order_.size());
    if (static_cast<double>(outside) > recipe_.cut_max_ratio * count || placed_.size() + in_gaps < 2)
      return refuse_it("fuse.log_does_not_cover",
                       std::to_string(outside) + " of " + std::to_string(order_.size()) + " frames lie outside the robot's log (" + fixed_number(robot_.begin_s(), 3) + " to " + fixed_number(robot_.end_s(), 3) +
                           " s); log from before the first frame to after the last.",
                       100 * static_cast<double>(outside) / count, 100 * recipe_.cut_max_ratio, "%");
    if (static_cast<double>(in_gaps) > recipe_.cut_max_ratio * count || placed_.size() < 2)
      return refuse_it("fuse.log_gaps",
                       std::to_string(in_gaps) + " of " + std::to_string(order_.size()) + " frames lie in gaps of the robot's log that are not bridged (" + std::to_string(robot_.lost_count()) +
                           " packets lost, the widest gap " + ms(robot_.gap_widest_s()) + " at " + fixed_number(robot_.gap_widest_at_s(), 3) + " s); scan again.",
                       100 * static_cast<double>(in_gaps) / count, 100 * recipe_.cut_max_ratio, "%");
    if (robot_.lost_count() > 0)
      note(Note::Level::warning, "fuse.log_packets_lost",
           std::to_string(robot_.lost_count()) + " packets of the robot's log are lost (widest gap " + ms(robot_.gap_widest_s()) + " at " + fixed_number(robot_.gap_widest_at_s(), 3) + " s); gaps up to " +
               ms(recipe_.gap_max_s) + " are bridged, which may cost up to " + fixed_number(bridged, 4) + " mm.");
    if (in_gaps > 0)
      note(Note::Level::warning, "fuse.frames_cut", std::to_string(in_gaps) + " frames lie in gaps of the robot's log too wide to be bridged (the first at " + fixed_number(gap_at, 3) + " s) and were left out.");
    double blur = 0;
    for (const Placed& p : placed_) blur = std::max(blur, p.at.velocity_mm_s.norm() * stream_.frames[p.frame].exposure_s);
    if (blur > 2 * limit_mm_)
      note(Note::Level::warning, "fuse.motion_blur", "The sensor moves up to " + fixed_number(blur, 3) + " mm during one exposure; scan slower or expose shorter.");
    divide_into_views();
    return true;
  }

  /// A view lasts until the sensor has turned or moved too far from where the view began; wider limits until there are few enough.
  void divide_into_views() {
    double turn = rad_from_deg(20), shift = 0.5 * std::max(20.0, sensor_.working_distance_mm);
    for (;; turn *= 1.3, shift *= 1.3) {
      int view = 0;
      std::size_t first = 0;
      for (std::size_t i = 0; i < placed_.size(); ++i) {
        const BaseSensor &a = placed_[first].T_base_sensor, &b = placed_[i].T_base_sensor;
        if (a.q.angularDistance(b.q) > turn || (a.p_mm - b.p_mm).norm() > shift) ++view, first = i;
        placed_[i].view = view;
      }
      if (view < std::clamp(recipe_.views_count_max, 1, 60)) return;
    }
  }

  // ---------------------------------------------------------------- points
  bool accumulate() {
    FusedStream& out = out_.artefact;
    const double pixel = rays_ ? sensor_.working_distance_mm / stream_.camera->fx_px : 0.1;
    const double wanted = recipe_.cell_mm > 0 ? recipe_.cell_mm : std::max(0.1, pixel);
    Cells cells(wanted, static_cast<std::size_t>(std::max(1000, recipe_.cells_count_max)));
    std::size_t frame_bytes = 0;
    struct Reading {
      Vec3 p_base;
      Eigen::Vector3f n_base;
      int weight;
    };
    std::vector<std::vector<Reading>> readings(kTogether);
    for (std::size_t begin = 0; begin < placed_.size(); begin += kTogether) {
      const std::size_t n = std::min(kTogether, placed_.size() - begin);
      const auto take = [&](std::size_t i, const auto& each) {
        const Placed& place = placed_[begin + i];
        std::vector<Reading>& list = readings[i];
        list.clear();
        const Mat3 R = place.T_base_sensor.rotation();
        each([&](const Vec3& p_sensor, const Eigen::Vector3f& n_sensor, float weight) {
          list.push_back({R * p_sensor + place.T_base_sensor.p_mm, R.cast<float>() * n_sensor, std::clamp(static_cast<int>(std::lround(64 * weight)), 1, 1023)});
        });
      };
      if (rays_) {
        std::vector<std::size_t> frames;
        for (std::size_t i = 0; i < n; ++i) frames.push_back(placed_[begin + i].frame);
        if (!with_frames(frames, [&](std::size_t i, const DepthPixels& image) {
              const DepthFrame f = frame_of(image, *rays_, sensor_, {}, 1);
              take(i, [&](const auto& put) {
                for (std::size_t k = 0; k < f.pixels.size(); ++k)
                  if (f.pixels[k].weight > 0) put(Vec3(rays_->ray(k).x(), rays_->ray(k).y(), 1) * static_cast<double>(f.pixels[k].z_mm), f.pixels[k].n_sensor, f.pixels[k].weight);
              });
            }))
          return false;
      } else {
        for (std::size_t i = 0; i < n; ++i)
          take(i, [&](const auto& put) {
            const StreamFrame& line = stream_.frames[placed_[begin + i].frame];
            for (std::size_t k = line.begin; k < line.end; ++k) put(capture_.points_sensor[k].cast<double>(), Eigen::Vector3f::Zero(), 1.f);
          });
      }
      std::size_t bytes = 0;
      for (std::size_t i = 0; i < n; ++i) {
        for (const Reading& r : readings[i]) cells.add(placed_[begin + i].view, r.p_base, r.n_base, r.weight);
        out.summary.points_count += readings[i].size();
        bytes += readings[i].capacity() * sizeof(Reading) + (rays_ ? stream_.camera->width_px * static_cast<std::size_t>(stream_.camera->height_px) * (sizeof(FramePixel) + 4) : 0);
      }
      frame_bytes = std::max(frame_bytes, bytes);
    }
    out.cell_mm = cells.cell_mm();
    if (out.cell_mm > 1.5 * wanted)
      note(Note::Level::warning, "fuse.cells_coarsened", "Cells of " + fixed_number(wanted, 3) + " mm would be more than " + std::to_string(recipe_.cells_count_max) + "; readings were averaged in cells of " + fixed_number(out.cell_mm, 3) + " mm.");
    std::vector<Cells::Point> points = cells.points();
    out.memory_bytes_count = cells.memory_bytes_count() + frame_bytes + points.size() * sizeof(Cells::Point);
    // a cell that far fewer frames saw than its view's others: readings that no other frame bears out
    const double per_frame = std::max(1.0, (out.cell_mm / std::max(1e-6, pixel)) * (out.cell_mm / std::max(1e-6, pixel)));
    const int views = placed_.empty() ? 0 : placed_.back().view + 1;
    for (int v = 0; v < views; ++v) {
      std::vector<std::uint32_t> counts;
      for (const Cells::Point& p : points)
        if (p.view == v) counts.push_back(p.readings_count);
      std::vector<const Placed*> of_view;
      for (const Placed& p : placed_)
        if (p.view == v) of_view.push_back(&p);
      if (counts.size() < 50) continue;
      std::nth_element(counts.begin(), counts.begin() + static_cast<std::ptrdiff_t>(counts.size() / 2), counts.end());
      const double usual = counts[counts.size() / 2];
      const Placed& middle = *of_view[of_view.size() / 2];
      FusedStream::View view;
      Capture& c = view.capture;
      c.name = capture_.name + "#" + std::to_string(out.views.size() + 1);
      c.sensor = capture_.sensor, c.feature = capture_.feature, c.T_base_flange = middle.at.T_base_flange;
      c.q_rad = joints_near(stream_.frames[middle.frame].t_s + clock_.offset_s);
      const auto to_sensor = middle.T_base_sensor.inverse();
      for (const Cells::Point& p : points)
        if (p.view == v && p.readings_count >= 0.1 * usual) c.points_sensor.push_back(to_sensor.point(p.p_base).cast<float>());
        else if (p.view == v) ++c.dropped_count;
      double speed = 0;
      for (const Placed* p : of_view) speed += p->at.velocity_mm_s.norm() / static_cast<double>(of_view.size());
      const double averaged = sensor_.noise_mm / std::sqrt(std::max(1.0, usual / per_frame));
      view.noise_mm = std::hypot(std::max(averaged, kFormRatio * sensor_.noise_mm), clock_.sigma_s * speed);
      out.views.push_back(std::move(view));
    }
    return true;
  }

  std::optional<std::array<double, 6>> joints_near(double when) const {
    const auto& samples = stream_.robot.samples;
    const auto it = std::lower_bound(samples.begin(), samples.end(), when, [](const RobotSample& s, double value) { return s.t_s < value; });
    const RobotSample& s = it == samples.end() ? samples.back() : *it;
    if (s.q_rad.size() != 6) return std::nullopt;
    std::array<double, 6> q{};
    std::copy_n(s.q_rad.begin(), 6, q.begin());
    return q;
  }
};

}  // namespace

Result<Done<FusedStream>> fuse_stream(const StreamRecipe& recipe, const Capture& capture, const SensorSpec& sensor, const FrameSource& frames) {
  must(capture.stream.has_value() && !capture.stream->frames.empty(), "fuse_stream: the capture is no stream");
  must(!capture.stream->camera || frames, "fuse_stream: a stream of images without a source of them");
  return StreamFusion(recipe, capture, sensor, frames).run();
}

}  // namespace asbuilt
