// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/robot/collision.hpp"

#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/narrowphase/distance.h>

#include <algorithm>
#include <cmath>

#include "planner/base/result.hpp"
#include "planner/robot/collision_detail.hpp"

namespace asbuilt {

using FclModel = fcl::BVHModel<fcl::OBBRSSd>;

struct BodySurface {
  FclModel model;
  MeshQuery inside;
};

namespace {

/// Small balls that together hold every triangle: the cells of the box that a triangle's own box touches.
std::vector<BodyShape::Ball> balls_of(const Mesh& mesh, const Box3& box) {
  std::vector<BodyShape::Ball> balls;
  const Vec3 size = box.max_mm - box.min_mm;
  const double cell = std::max(std::cbrt(std::max(size.x(), 1.0) * std::max(size.y(), 1.0) * std::max(size.z(), 1.0) / 20.0), 1e-3);
  Eigen::Vector3i n;
  for (int i = 0; i < 3; ++i) n[i] = std::clamp(static_cast<int>(std::ceil(size[i] / cell)), 1, 8);
  const Vec3 step(size.x() / n.x(), size.y() / n.y(), size.z() / n.z());
  std::vector<char> is_used(static_cast<std::size_t>(n.prod()), 0);
  for (const auto& t : mesh.triangles) {
    Box3 b;
    for (const int v : t) b.extend(mesh.vertices[v]);
    Eigen::Vector3i lo, hi;
    for (int i = 0; i < 3; ++i) {
      lo[i] = step[i] > 0 ? std::clamp(static_cast<int>((b.min_mm[i] - box.min_mm[i]) / step[i]), 0, n[i] - 1) : 0;
      hi[i] = step[i] > 0 ? std::clamp(static_cast<int>((b.max_mm[i] - box.min_mm[i]) / step[i]), 0, n[i] - 1) : 0;
    }
    for (int x = lo.x(); x <= hi.x(); ++x)
      for (int y = lo.y(); y <= hi.y(); ++y)
        for (int z = lo.z(); z <= hi.z(); ++z) is_used[(x * n.y() + y) * n.z() + z] = 1;
  }
  for (int x = 0; x < n.x(); ++x)
    for (int y = 0; y < n.y(); ++y)
      for (int z = 0; z < n.z(); ++z)
        if (is_used[(x * n.y() + y) * n.z() + z])
          balls.push_back({box.min_mm + step.cwiseProduct(Vec3(x + 0.5, y + 0.5, z + 0.5)), 0.5 * step.norm() * (1 + 1e-9)});
  return balls;
}

/// One vertex of each connected piece of the mesh.
std::vector<Vec3> piece_points(const Mesh& mesh) {
  std::vector<int> parent(mesh.vertices.size());
  for (std::size_t i = 0; i < parent.size(); ++i) parent[i] = static_cast<int>(i);
  const auto root = [&](int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  for (const auto& t : mesh.triangles)
    for (int k = 1; k < 3; ++k) {
      const int a = root(t[0]), b = root(t[k]);
      if (a != b) parent[std::max(a, b)] = std::min(a, b);
    }
  std::vector<char> is_seen(mesh.vertices.size(), 0);
  std::vector<Vec3> points;
  for (const auto& t : mesh.triangles) {
    const int r = root(t[0]);
    if (is_seen[r] || points.size() >= 64) continue;
    is_seen[r] = 1;
    points.push_back(mesh.vertices[t[0]]);
  }
  return points;
}

double distance_to_box(const Vec3& p, const Box3& box) {
  return (p - p.cwiseMax(box.min_mm).cwiseMin(box.max_mm)).norm();
}

double balls_to_box(const BodyShape& balls, const Rigid& T_box_balls, const Box3& box) {
  double d = 1e9;
  for (const auto& b : balls.balls) d = std::min(d, distance_to_box(T_box_balls.R * b.center + T_box_balls.p, box) - b.radius_mm);
  return d;
}

fcl::Transform3d transform_of(const Rigid& T) {
  fcl::Transform3d t = fcl::Transform3d::Identity();
  t.linear() = T.R;
  t.translation() = T.p;
  return t;
}

/// A piece of `b` lies inside `a` (both in their own frames).
bool holds_a_piece(const BodyShape& a, const BodyShape& b, const Rigid& T_a_b) {
  for (const Vec3& v : b.piece_points) {
    const Vec3 p = T_a_b.R * v + T_a_b.p;
    if ((p.array() < a.box.min_mm.array()).any() || (p.array() > a.box.max_mm.array()).any()) continue;
    if (a.surface->inside.contains(p)) return true;
  }
  return false;
}

}  // namespace

CollisionScene::CollisionScene(const Robot& robot) : impl_(std::make_shared<Impl>(Impl{robot, {}})) {}
const Robot& CollisionScene::robot() const { return impl_->robot; }
const std::string& CollisionScene::name(int body) const { return impl_->bodies.at(static_cast<std::size_t>(body)).name; }
int CollisionScene::mount(int body) const { return impl_->bodies.at(static_cast<std::size_t>(body)).mount; }
int CollisionScene::size() const { return static_cast<int>(impl_->bodies.size()); }

int CollisionScene::add(const std::string& name, int mount, Mesh mesh) {
  must(mount >= kMountBase && mount <= kMountFlange, "a body hangs on base, link 1..6 or the flange");
  BodyShape b;
  b.name = name;
  b.mount = mount;
  if (!mesh.triangles.empty()) {
    for (const auto& t : mesh.triangles)
      for (const int v : t) b.box.extend(mesh.vertices[v]);
    b.balls = balls_of(mesh, b.box);
    b.piece_points = piece_points(mesh);
    for (int i = 0; i < 8; ++i)
      b.corners[i] = {i & 1 ? b.box.max_mm.x() : b.box.min_mm.x(), i & 2 ? b.box.max_mm.y() : b.box.min_mm.y(),
                      i & 4 ? b.box.max_mm.z() : b.box.min_mm.z()};
    auto surface = std::make_shared<BodySurface>();
    std::vector<fcl::Vector3d> points(mesh.vertices.begin(), mesh.vertices.end());
    std::vector<fcl::Triangle> triangles;
    for (const auto& t : mesh.triangles) triangles.emplace_back(t[0], t[1], t[2]);
    surface->model.beginModel(static_cast<int>(triangles.size()), static_cast<int>(points.size()));
    surface->model.addSubModel(points, triangles);
    surface->model.endModel();
    surface->inside = MeshQuery(std::move(mesh));
    b.surface = std::move(surface);
  }
  impl_->bodies.push_back(std::move(b));
  return size() - 1;
}

std::array<Rigid, 8> mount_poses(const Robot& robot, const JointVector& q_rad) {
  std::array<Rigid, 8> T;
  const auto links = robot.link_motion(q_rad);
  for (int i = 1; i <= 6; ++i) T[i] = rigid_of(links[i]);
  T[kMountFlange] = rigid_of(robot.forward(q_rad));
  return T;
}

double lower_bound(const BodyShape& a, const BodyShape& b, const Rigid& T_a_b) {
  if (!a.surface || !b.surface) return 1e9;
  return std::max(0.0, std::max(balls_to_box(b, T_a_b, a.box), balls_to_box(a, T_a_b.inverse(), b.box)));
}

Separation exact_separation(const BodyShape& a, const BodyShape& b, const Rigid& T_base_a, const Rigid& T_base_b) {
  Separation s;
  s.is_exact = true;
  if (!a.surface || !b.surface) return s;
  fcl::DistanceRequestd request(true);
  fcl::DistanceResultd result;
  s.distance_mm = fcl::distance(&a.surface->model, transform_of(T_base_a), &b.surface->model, transform_of(T_base_b), request, result);
  if (!(s.distance_mm > 0)) s.distance_mm = 0;
  s.p_base = 0.5 * (result.nearest_points[0] + result.nearest_points[1]);
  if (s.distance_mm > 0) {
    const Rigid T_a_b = T_base_a.inverse() * T_base_b;
    if (holds_a_piece(a, b, T_a_b) || holds_a_piece(b, a, T_a_b.inverse())) s.distance_mm = 0;
  }
  return s;
}

Separation CollisionScene::separation(int a, int b, const JointVector& q_rad, double enough_mm) const {
  const BodyShape &x = impl_->bodies.at(static_cast<std::size_t>(a)), &y = impl_->bodies.at(static_cast<std::size_t>(b));
  const auto T = mount_poses(impl_->robot, q_rad);
  const double bound = lower_bound(x, y, T[x.mount].inverse() * T[y.mount]);
  if (bound >= enough_mm) return {bound, false, Vec3::Zero()};
  return exact_separation(x, y, T[x.mount], T[y.mount]);
}

}  // namespace asbuilt
