// SPDX-License-Identifier: GPL-3.0-or-later
// Detection by kind of target, and the views' whole poses where the target gives them.
#include "planner/calibrate/observe.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "planner/base/number.hpp"
#include "planner/calibrate/image_targets.hpp"
#include "planner/calibrate/spheres.hpp"

namespace asbuilt {

namespace {

constexpr double kFree = std::numeric_limits<double>::infinity();
constexpr std::size_t kPointsPerView = 120;  // of a surface: more only repeat the robot's error

NetworkView view_of(const TargetCapture& c) {
  NetworkView v;
  v.name = c.name, v.T_base_flange = c.T_base_flange, v.is_held_out = c.is_held_out;
  return v;
}

std::vector<Observation> thinned(const std::vector<Vec3>& points, const std::vector<std::size_t>& in, int id) {
  std::vector<Observation> out;
  const std::size_t n = std::min(kPointsPerView, in.size());
  for (std::size_t i = 0; i < n; ++i) out.push_back({Vec3::Zero(), points[in[i * in.size() / n]], id});
  return out;
}

void observe_balls(const CalibrationRequest& job, Observed& o) {
  const double radius = job.target.diameter_mm / 2;
  o.network.sight = Sight::point;
  const SphereRecipe recipe{.radius_mm = radius, .sigma_mm = job.sensor_sd, .balls_max_count = static_cast<int>(job.target.centers_mm.size())};
  double ratio_sum = 0, ratio_count = 0, length_square = 0;
  for (std::size_t k = 0; k < job.captures.size(); ++k) {
    const TargetCapture& c = job.captures[k];
    NetworkView v = view_of(c);
    const auto found = find_spheres(recipe, c.points_mm, 1);
    std::vector<Vec3> centers;
    double free_radius = 0, cap = 1e9;
    for (const SphereFit& f : found) centers.push_back(f.center), free_radius += f.free_radius_mm / static_cast<double>(found.size()), cap = std::min(cap, f.cap_rad);
    // a sensor whose lengths are off by some percent must still know who is who
    const double size = 0.5 * ([&] {
      double most = 0;
      for (const Vec3& a : job.target.centers_mm)
        for (const Vec3& b : job.target.centers_mm) most = std::max(most, (a - b).norm());
      return most;
    })();
    const auto who = identify_balls(centers, job.target.centers_mm, std::max(10 * job.sensor_sd, 0.03 * size));
    std::vector<Vec3> a, b;
    for (std::size_t i = 0; i < centers.size(); ++i)
      if (who[i]) v.observations.push_back({job.target.centers_mm[static_cast<std::size_t>(*who[i])], centers[i], *who[i]}), a.push_back(v.observations.back().p_target), b.push_back(centers[i]);
    SeenLine line{c.name, {}, a.size() >= 3};
    if (a.size() < 3) {
      line.text = fmt::format("{} balls found, {} named by their distances; three are needed", found.size(), a.size());
      v.observations.clear();
    } else {
      line.text = fmt::format("{} of {} balls, caps of {} deg and more, free radius {} mm (certified {})", a.size(), job.target.centers_mm.size(), fixed_number(deg_from_rad(cap), 0),
                              fixed_number(free_radius, 4), fixed_number(radius, 4));
      for (std::size_t i = 0; i < a.size(); ++i)
        for (std::size_t j = i + 1; j < a.size(); ++j) {
          const double known = (a[i] - a[j]).norm();
          ratio_sum += known * (b[i] - b[j]).norm(), length_square += known * known, ratio_count += 1;
        }
      o.motions.push_back({c.name, place_mount(c.T_base_flange, job.is_sensor_fixed), pose_of_points(a, b)});
      o.motion_view.push_back(k);
    }
    o.seen.push_back(line);
    o.network.views.push_back(std::move(v));
  }
  o.sensor_sd = 0.5 * job.sensor_sd;
  if (ratio_count > 0) o.length_ratio = ratio_sum / length_square, o.length_sd_ratio = o.sensor_sd * std::sqrt(2 / length_square);
}

void observe_ball(const CalibrationRequest& job, Observed& o) {
  const double radius = job.target.diameter_mm / 2;
  const bool is_line = std::all_of(job.captures.begin(), job.captures.end(), [](const TargetCapture& c) { return is_profile(c.points_mm); });
  o.network.is_target_free = {true, true, true, false, false, false};
  o.base.sensor[kRadius] = radius;
  o.sensor_sd = job.sensor_sd;
  if (!is_line) {
    o.network.sight = Sight::point;
    o.sensor_sd = 0.5 * job.sensor_sd;
    for (const TargetCapture& c : job.captures) {
      NetworkView v = view_of(c);
      auto found = find_spheres({.radius_mm = radius, .sigma_mm = job.sensor_sd, .balls_max_count = 1}, c.points_mm, 1);
      if (found.empty())  // a sensor whose lengths are off by some percent sees a ball of another size
        found = find_spheres({.radius_mm = radius, .sigma_mm = std::max(job.sensor_sd, 0.015 * radius), .balls_max_count = 1}, c.points_mm, 1);
      SeenLine line{c.name, "no ball found", !found.empty()};
      if (!found.empty()) {
        v.observations.push_back({Vec3::Zero(), found[0].center, 0});
        line.text = fmt::format("{} points, cap {} deg, rms {} mm, free radius {} mm (certified {})", found[0].points_count, fixed_number(deg_from_rad(found[0].cap_rad), 0),
                                fixed_number(found[0].rms_mm, 4), fixed_number(found[0].free_radius_mm, 4), fixed_number(radius, 4));
      }
      o.seen.push_back(line);
      o.network.views.push_back(std::move(v));
    }
    o.starts = ball_line_starts(o.network, radius, job.sensor_sd, job.nominal);
    return;
  }
  o.network.sight = Sight::sphere;
  for (const TargetCapture& c : job.captures) {
    NetworkView v = view_of(c);
    const auto arc = find_arc(c.points_mm, radius, job.sensor_sd, 3);
    SeenLine line{c.name, "no arc of the ball found", arc.has_value()};
    if (arc) {
      v.observations = thinned(c.points_mm, arc->inliers, 0);
      line.text = fmt::format("{} of {} points on an arc of radius {} mm, rms {} mm", arc->inliers.size(), c.points_mm.size(), fixed_number(arc->radius_mm, 3), fixed_number(arc->rms_mm, 4));
    }
    o.seen.push_back(line);
    o.network.views.push_back(std::move(v));
  }
  o.starts = ball_line_starts(o.network, radius, job.sensor_sd, job.nominal);
}

tl::expected<void, Refusals> observe_board(const CalibrationRequest& job, Observed& o) {
  o.network.sight = Sight::pixel;
  const std::vector<Vec3> board = board_points(job.target);
  std::vector<std::vector<ImagePoint>> all;
  for (const TargetCapture& c : job.captures) {
    std::vector<ImagePoint> points = c.corners;
    if (points.empty() && !c.image.empty()) {
      auto found = find_board(job.target, c.image, c.name);
      if (!found) return tl::unexpected(found.error());
      points = std::move(*found);
    }
    all.push_back(std::move(points));
  }
  CameraConstants camera{};
  if (job.camera) {
    camera = *job.camera;
  } else if (const auto guess = camera_guess(board, all)) {
    camera = *guess;
  } else {
    return tl::unexpected(Refusals{{.code = "calibrate.target_not_seen",
                                    .where = "captures",
                                    .message = "the board was seen in fewer than three images, from which no camera can be found; give `intrinsics`, or take images with the whole board inside",
                                    .limit = 3,
                                    .unit = "images",
                                    .stage = "input"}});
  }
  for (int i = 0; i < 9; ++i) o.base.sensor[kFx + i] = camera[static_cast<std::size_t>(i)];
  if (job.is_camera_free)
    for (int i = kFx; i <= kP2; ++i) o.network.sensor_sd[i] = kFree;
  // half a turn of a board looks the same; of a square one a quarter
  const int turns = job.target.kind == TargetKind::charuco ? 1 : job.target.columns_count == job.target.rows_count ? 4 : 2;
  const Vec3 far((job.target.columns_count - 1) * job.target.pitch_mm, (job.target.rows_count - 1) * job.target.pitch_mm, 0);
  const auto turn_pose = [&](int t) {
    const double angle = turns == 4 ? t * kPi / 2 : t * kPi;
    const Vec3 half = 0.5 * far;
    const Eigen::Quaterniond q = quat_exp(Vec3(0, 0, angle));
    return Pose<frame::Target, frame::Target>(q, half - q * half);  // about the board's middle
  };
  std::vector<Pose<frame::Place, frame::Mount>> robot;
  std::vector<std::vector<Pose<frame::Sensor, frame::Target>>> turned;
  std::vector<std::size_t> at;
  for (std::size_t k = 0; k < job.captures.size(); ++k) {
    const TargetCapture& c = job.captures[k];
    NetworkView v = view_of(c);
    const auto pose = board_pose(board, all[k], camera);
    SeenLine line{c.name, "the board was not seen whole", pose.has_value()};
    if (pose) {
      line.text = fmt::format("{} points, by themselves {} px rms", all[k].size(), fixed_number(pose->rms_px, 3));
      robot.push_back(place_mount(c.T_base_flange, job.is_sensor_fixed));
      turned.emplace_back();
      for (int t = 0; t < turns; ++t) turned.back().push_back(pose->T_sensor_target * turn_pose(t));
      at.push_back(k);
    }
    o.seen.push_back(line);
    o.network.views.push_back(std::move(v));
  }
  const std::vector<int> pick = turned.empty() ? std::vector<int>() : choose_turns(robot, turned);
  std::string flipped;
  for (std::size_t i = 0; i < at.size(); ++i) {
    const auto back = turn_pose(pick[i]).inverse();
    for (const ImagePoint& p : all[at[i]]) o.network.views[at[i]].observations.push_back({back.point(board[static_cast<std::size_t>(p.id)]), Vec3(p.at_px.x(), p.at_px.y(), 0), p.id});
    o.motions.push_back({job.captures[at[i]].name, robot[i], turned[i][static_cast<std::size_t>(pick[i])]});
    o.motion_view.push_back(at[i]);
    if (pick[i] != pick[0]) flipped += (flipped.empty() ? "" : ", ") + job.captures[at[i]].name;
  }
  if (!flipped.empty())
    o.notes.push_back({.level = Note::Level::note,
                       .code = "calibrate.board_turned",
                       .text = "the board's points came out turned against the other images and were put right by the robot's motion: " + flipped,
                       .where = "captures"});
  o.sensor_sd = job.sensor_sd;
  return {};
}

void observe_plane(const CalibrationRequest& job, Observed& o) {
  o.network.sight = Sight::plane;
  o.network.is_target_free = {false, false, true, true, true, false};
  o.sensor_sd = job.sensor_sd;
  Vec3 normal = Vec3::Zero(), middle = Vec3::Zero();
  double n = 0;
  for (const TargetCapture& c : job.captures) {
    NetworkView v = view_of(c);
    const auto plane = find_plane(c.points_mm, job.sensor_sd, 20, 5);
    SeenLine line{c.name, "no plane found", plane.has_value()};
    if (plane) {
      v.observations = thinned(c.points_mm, plane->inliers, 2);
      line.text = fmt::format("{} of {} points on the plane, rms {} mm", plane->inliers.size(), c.points_mm.size(), fixed_number(plane->rms_mm, 4));
      if (job.nominal) {
        const Pose<frame::Mount, frame::Sensor> X(job.nominal->q, job.nominal->p_mm);
        const auto A = place_mount(c.T_base_flange, job.is_sensor_fixed) * X;
        for (const Observation& p : v.observations) middle += A.point(p.z), n += 1;
        normal += A.q * plane->normal;
      }
    }
    o.seen.push_back(line);
    o.network.views.push_back(std::move(v));
  }
  if (job.nominal && n > 0) {
    MotionStart s;
    s.method = "cell";
    s.T_mount_sensor = {job.nominal->q, job.nominal->p_mm};
    s.T_place_target = {quat_from_z(normal.normalized(), Vec3::UnitX()), middle / n};
    o.starts.push_back(s);
  }
}

/// Three planes that meet in a corner. Which is which is cyclic; the robot's motion decides.
tl::expected<void, Refusals> observe_corner(const CalibrationRequest& job, Observed& o) {
  o.network.sight = Sight::plane;
  o.sensor_sd = job.sensor_sd;
  std::vector<Pose<frame::Place, frame::Mount>> robot;
  std::vector<std::vector<Pose<frame::Sensor, frame::Target>>> turned;
  std::vector<std::array<std::vector<Observation>, 3>> faces;
  std::vector<std::size_t> at;
  double worst_deg = 0;
  std::string worst;
  for (std::size_t k = 0; k < job.captures.size(); ++k) {
    const TargetCapture& c = job.captures[k];
    o.network.views.push_back(view_of(c));
    SeenLine line{c.name, "no three planes found", false};
    std::vector<Vec3> rest = c.points_mm;
    std::vector<PlaneFit> planes;
    std::vector<std::vector<Vec3>> on;
    for (int i = 0; i < 3; ++i) {
      const auto p = find_plane(rest, job.sensor_sd, 50, 11 + static_cast<std::uint64_t>(i));
      if (!p) break;
      std::vector<Vec3> mine, left;
      for (const Vec3& q : rest) {
        const double d = std::abs(p->normal.dot(q) - p->distance_mm);
        if (d > 12 * job.sensor_sd) left.push_back(q);
        else if (d < 4 * job.sensor_sd) mine.push_back(q);
      }
      planes.push_back(*p), on.push_back(std::move(mine));
      rest.swap(left);
    }
    if (planes.size() == 3) {
      Mat3 N;
      for (int i = 0; i < 3; ++i) N.row(i) = planes[static_cast<std::size_t>(i)].normal.transpose();
      if (N.determinant() < 0) std::swap(planes[1], planes[2]), std::swap(on[1], on[2]), N.row(1).swap(N.row(2));
      if (std::abs(N.determinant()) > 0.2) {
        const Vec3 corner = N.partialPivLu().solve(Vec3(planes[0].distance_mm, planes[1].distance_mm, planes[2].distance_mm));
        double off = 0;
        for (int i = 0; i < 3; ++i) off = std::max(off, std::abs(90 - deg_from_rad(std::acos(std::clamp(N.row(i).dot(N.row((i + 1) % 3)), -1.0, 1.0)))));
        if (off > worst_deg) worst_deg = off, worst = c.name;
        line.is_seen = true;
        line.text = fmt::format("three planes with {}, {}, {} points, square within {} deg", on[0].size(), on[1].size(), on[2].size(), fixed_number(off, 2));
        robot.push_back(place_mount(c.T_base_flange, job.is_sensor_fixed));
        turned.emplace_back();
        faces.emplace_back();
        at.push_back(k);
        for (int t = 0; t < 3; ++t) {
          Mat3 R;
          for (int i = 0; i < 3; ++i) R.col(i) = N.row((i + t) % 3).transpose();
          Eigen::JacobiSVD<Mat3> svd(R, Eigen::ComputeFullU | Eigen::ComputeFullV);
          turned.back().push_back({Eigen::Quaterniond(Mat3(svd.matrixU() * svd.matrixV().transpose())).normalized(), corner});
        }
        for (int i = 0; i < 3; ++i) {
          std::vector<std::size_t> every(on[static_cast<std::size_t>(i)].size());
          for (std::size_t j = 0; j < every.size(); ++j) every[j] = j;
          faces.back()[static_cast<std::size_t>(i)] = thinned(on[static_cast<std::size_t>(i)], every, i);
        }
      }
    }
    o.seen.push_back(line);
  }
  if (worst_deg > 1.0)
    return tl::unexpected(Refusals{{.code = "calibrate.corner_not_square",
                                    .where = worst,
                                    .message = fmt::format("the three planes of {} are {} deg from square, allowed 1 deg: something else was seen, or the corner is none of three square faces", worst,
                                                           fixed_number(worst_deg, 2)),
                                    .measured = worst_deg,
                                    .limit = 1,
                                    .unit = "deg",
                                    .stage = "input"}});
  const std::vector<int> pick = turned.empty() ? std::vector<int>() : choose_turns(robot, turned);
  for (std::size_t i = 0; i < at.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis)
      for (Observation p : faces[i][static_cast<std::size_t>((axis + pick[i]) % 3)]) p.id = axis, o.network.views[at[i]].observations.push_back(p);
    o.motions.push_back({job.captures[at[i]].name, robot[i], turned[i][static_cast<std::size_t>(pick[i])]});
    o.motion_view.push_back(at[i]);
  }
  return {};
}

void observe_tip(const CalibrationRequest& job, Observed& o) {
  o.network.sight = Sight::point;
  o.network.is_mount_free = o.network.is_target_free = {true, true, true, false, false, false};
  o.sensor_sd = job.sensor_sd;
  MotionStart s;
  s.method = "pivot";
  if (job.nominal) s.T_mount_sensor.q = job.nominal->q;
  // R t + p = c over all views, linear
  Mat6 N = Mat6::Identity() * 1e-12;
  Vec6 g = Vec6::Zero();
  for (const TargetCapture& c : job.captures) {
    NetworkView v = view_of(c);
    v.observations.push_back({Vec3::Zero(), Vec3::Zero(), 0});
    Eigen::Matrix<double, 3, 6> J;
    J << c.T_base_flange.rotation(), -Mat3::Identity();
    N += J.transpose() * J, g -= J.transpose() * c.T_base_flange.p_mm;
    o.network.views.push_back(std::move(v));
    o.seen.push_back({c.name, "tip on the point", true});
  }
  const Vec6 x = N.ldlt().solve(g);
  s.T_mount_sensor.p_mm = x.head<3>(), s.T_place_target.p_mm = x.tail<3>();
  o.starts.push_back(s);
}

void observe_pose(const CalibrationRequest& job, Observed& o) {
  o.network.sight = Sight::pose;
  o.sensor_sd = job.sensor_sd;
  for (std::size_t k = 0; k < job.captures.size(); ++k) {
    const TargetCapture& c = job.captures[k];
    NetworkView v = view_of(c);
    v.T_sensor_target = c.T_sensor_target;
    o.network.views.push_back(std::move(v));
    o.seen.push_back({c.name, "pose as given", c.T_sensor_target.has_value()});
    if (!c.T_sensor_target) continue;
    o.motions.push_back({c.name, place_mount(c.T_base_flange, job.is_sensor_fixed), *c.T_sensor_target});
    o.motion_view.push_back(k);
  }
}

}  // namespace

Result<Observed> observe(const CalibrationRequest& job) {
  Observed o;
  o.network.is_sensor_fixed = job.is_sensor_fixed;
  tl::expected<void, Refusals> done{};
  switch (job.target.kind) {
    case TargetKind::balls: observe_balls(job, o); break;
    case TargetKind::ball: observe_ball(job, o); break;
    case TargetKind::checkerboard:
    case TargetKind::charuco:
    case TargetKind::circle_grid: done = observe_board(job, o); break;
    case TargetKind::plane: observe_plane(job, o); break;
    case TargetKind::corner: done = observe_corner(job, o); break;
    case TargetKind::tip: observe_tip(job, o); break;
    case TargetKind::pose: observe_pose(job, o); break;
    case TargetKind::hole_plate:
      return refuse({.code = "calibrate.target_not_supported",
                     .where = "target.kind",
                     .message = "found a plate with holes for a sensor that is no laser profilometer, allowed: sensor of kind profile",
                     .stage = "input"});
  }
  if (!done) return tl::unexpected(done.error());
  return o;
}

}  // namespace asbuilt
