// SPDX-License-Identifier: GPL-3.0-or-later
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "planner/base/random.hpp"
#include "planner/calibrate/observe.hpp"

namespace asbuilt {

std::optional<PlaneFit> find_plane(const std::vector<Vec3>& points, double sigma_mm, std::size_t min_count, std::uint64_t seed) {
  if (points.size() < std::max<std::size_t>(3, min_count)) return std::nullopt;
  Random random(seed);
  const double gate = 4 * sigma_mm;
  const std::size_t step = 1 + points.size() / 4000;
  std::size_t best_count = 0;
  Vec3 best_n = Vec3::UnitZ();
  double best_d = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const Vec3 &a = points[random.below(points.size())], &b = points[random.below(points.size())], &c = points[random.below(points.size())];
    const Vec3 n0 = (b - a).cross(c - a);
    if (n0.norm() < 1e-9) continue;
    const Vec3 n = n0.normalized();
    const double d = n.dot(a);
    std::size_t count = 0;
    for (std::size_t i = 0; i < points.size(); i += step) count += std::abs(n.dot(points[i]) - d) < gate;
    if (count > best_count) best_count = count, best_n = n, best_d = d;
  }
  PlaneFit f;
  for (int round = 0; round < 8; ++round) {
    Vec3 mean = Vec3::Zero();
    std::vector<std::size_t> in;
    for (std::size_t i = 0; i < points.size(); ++i)
      if (std::abs(best_n.dot(points[i]) - best_d) < gate) in.push_back(i), mean += points[i];
    if (in.size() < std::max<std::size_t>(3, min_count)) return std::nullopt;
    mean /= static_cast<double>(in.size());
    Mat3 M = Mat3::Zero();
    for (std::size_t i : in) M += (points[i] - mean) * (points[i] - mean).transpose();
    Eigen::SelfAdjointEigenSolver<Mat3> es(M);
    best_n = es.eigenvectors().col(0), best_d = best_n.dot(mean);
    f.rms_mm = std::sqrt(std::max(0.0, es.eigenvalues()[0]) / static_cast<double>(in.size()));
    f.inliers = std::move(in);
  }
  if (best_d > 0) best_n = -best_n, best_d = -best_d;  // the sensor at the origin is on the normal's side
  f.normal = best_n, f.distance_mm = best_d;
  return f;
}

bool is_profile(const std::vector<Vec3>& points) {
  if (points.size() < 3) return false;
  for (const Vec3& p : points)
    if (std::abs(p.y() - points.front().y()) > 1e-6) return false;
  return true;
}

std::optional<ArcFit> find_arc(const std::vector<Vec3>& points, double radius_max_mm, double sigma_mm, std::uint64_t seed) {
  if (points.size() < 12) return std::nullopt;
  Random random(seed);
  const double gate = 4 * sigma_mm;
  const auto count_of = [&](double x, double z, double r) {
    std::size_t n = 0;
    for (const Vec3& p : points) n += std::abs(std::hypot(p.x() - x, p.z() - z) - r) < gate;
    return n;
  };
  std::size_t best = 0;
  double bx = 0, bz = 0, br = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    // three points of one neighbourhood: the first anywhere, the others within the ball's size
    const Vec3& a = points[random.below(points.size())];
    const Vec3& b = points[random.below(points.size())];
    const Vec3& c = points[random.below(points.size())];
    if ((a - b).norm() > 2 * radius_max_mm || (a - c).norm() > 2 * radius_max_mm) continue;
    Eigen::Matrix2d M;
    M << 2 * (b.x() - a.x()), 2 * (b.z() - a.z()), 2 * (c.x() - a.x()), 2 * (c.z() - a.z());
    if (std::abs(M.determinant()) < 0.02 * radius_max_mm * radius_max_mm) continue;
    const Vec2 v(b.squaredNorm() - a.squaredNorm() - (b.y() * b.y() - a.y() * a.y()), c.squaredNorm() - a.squaredNorm() - (c.y() * c.y() - a.y() * a.y()));
    const Vec2 m = M.partialPivLu().solve(v);
    const double r = std::hypot(a.x() - m.x(), a.z() - m.y());
    if (r > 1.03 * radius_max_mm || r < 0.15 * radius_max_mm) continue;
    const std::size_t n = count_of(m.x(), m.y(), r);
    if (n > best) best = n, bx = m.x(), bz = m.y(), br = r;
  }
  if (best < 12) return std::nullopt;
  ArcFit f;
  for (int round = 0; round < 15; ++round) {
    Mat3 N = Mat3::Zero();
    Vec3 g = Vec3::Zero();
    double sum = 0;
    f.inliers.clear();
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double dx = points[i].x() - bx, dz = points[i].z() - bz, d = std::hypot(dx, dz), r = d - br;
      if (std::abs(r) > gate || d < 1e-9) continue;
      const Vec3 j(-dx / d, -dz / d, -1);
      N += j * j.transpose(), g -= j * r, sum += r * r;
      f.inliers.push_back(i);
    }
    if (f.inliers.size() < 12) return std::nullopt;
    const Vec3 s = N.ldlt().solve(g);
    bx += s[0], bz += s[1], br += s[2];
    f.rms_mm = std::sqrt(sum / static_cast<double>(f.inliers.size()));
  }
  if (br > 1.05 * radius_max_mm) return std::nullopt;
  f.center = Vec3(bx, points.front().y(), bz), f.radius_mm = br;
  return f;
}

std::vector<MotionStart> ball_line_starts(const Network& network, double radius_mm, double sigma_mm, const std::optional<Pose<frame::Flange, frame::Sensor>>& nominal) {
  // arcs' centres stand for the ball's; how far the ball is off the laser's plane follows from the arc's radius, its side from the solve
  struct Arc {
    Vec3 center;
    double off_mm;
  };
  Network points = network;
  points.sight = Sight::point;
  points.is_target_free = {true, true, true, false, false, false};
  std::vector<Arc> arcs;
  for (NetworkView& v : points.views) {
    std::vector<Vec3> p;
    for (const Observation& o : v.observations) p.push_back(o.z);
    if (network.sight == Sight::point) {  // whole centres
      arcs.push_back({p.empty() ? Vec3::Zero() : p[0], 0});
      continue;
    }
    v.observations.clear();
    const auto arc = find_arc(p, radius_mm, sigma_mm, 7);
    arcs.push_back({Vec3::Zero(), 0});
    if (!arc) continue;
    arcs.back() = {arc->center, std::sqrt(std::max(0.0, radius_mm * radius_mm - arc->radius_mm * arc->radius_mm))};
    v.observations.push_back({Vec3::Zero(), arc->center, 0});
  }
  NetworkRecipe quick;
  quick.sensor_sd_mm = 0.2 * radius_mm, quick.robot_sd_mm = 0.05, quick.robot_sd_rad = 1e-4, quick.rounds_count = 0;
  std::vector<std::pair<double, MotionStart>> found;
  std::vector<Eigen::Quaterniond> turns;
  if (nominal) turns.push_back(nominal->q);
  for (const Vec3& z : {Vec3(0, 0, 1), Vec3(0, 0, -1), Vec3(1, 0, 0), Vec3(-1, 0, 0), Vec3(0, 1, 0), Vec3(0, -1, 0)})
    for (int roll = 0; roll < 8; ++roll) turns.push_back(quat_from_z(z, Vec3(0.3, 0.5, 0.8)) * quat_exp(Vec3(0, 0, roll * kPi / 4)));
  for (std::size_t i = 0; i < turns.size(); ++i) {
    NetworkState s;
    s.T_mount_sensor = {turns[i], nominal && i == 0 ? nominal->p_mm : Vec3::Zero()};
    // the best shift and ball for this turn: linear
    Eigen::Matrix<double, 6, 6> N = Eigen::Matrix<double, 6, 6>::Identity() * 1e-9;
    Vec6 g = Vec6::Zero();
    const auto place_ball = [&]() {
      N = Eigen::Matrix<double, 6, 6>::Identity() * 1e-9, g.setZero();
      for (const NetworkView& v : points.views) {
        if (v.observations.empty()) continue;
        const auto A = place_mount(v.T_base_flange, network.is_sensor_fixed);
        Eigen::Matrix<double, 3, 6> J;
        J << A.rotation(), -Mat3::Identity();
        const Vec3 r = -(A.q * (s.T_mount_sensor.q * v.observations[0].z) + A.p_mm);
        N += J.transpose() * J, g += J.transpose() * r;
      }
      const Vec6 x = N.ldlt().solve(g);
      s.T_mount_sensor.p_mm = x.head<3>(), s.T_place_target.p_mm = x.tail<3>();
    };
    for (std::size_t k = 0; k < points.views.size(); ++k)
      if (!points.views[k].observations.empty()) points.views[k].observations[0].z = arcs[k].center;
    place_ball();
    NetworkSolution solved = solve_network(quick, points, s);
    for (int round = 0; round < (network.sight == Sight::point ? 0 : 3); ++round) {
      for (std::size_t k = 0; k < points.views.size(); ++k) {
        if (points.views[k].observations.empty()) continue;
        const double y = target_in_sensor(points, points.views[k], solved.state).p_mm.y();
        points.views[k].observations[0].z.y() = arcs[k].center.y() + (y < arcs[k].center.y() ? -1 : 1) * arcs[k].off_mm;
      }
      solved = solve_network(quick, points, solved.state);
    }
    MotionStart m;
    m.method = nominal && i == 0 ? "cell" : "grid " + std::to_string(i);
    m.T_mount_sensor = solved.state.T_mount_sensor, m.T_place_target = solved.state.T_place_target;
    found.emplace_back(solved.cost, m);
  }
  std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<MotionStart> out;
  for (const auto& [cost, m] : found) {
    bool is_new = true;
    for (const MotionStart& o : out) is_new = is_new && (quat_log(o.T_mount_sensor.q.conjugate() * m.T_mount_sensor.q).norm() > 0.01 || (o.T_mount_sensor.p_mm - m.T_mount_sensor.p_mm).norm() > 1);
    if (is_new) out.push_back(m);
    if (out.size() == 5) break;
  }
  return out;
}

}  // namespace asbuilt
