// SPDX-License-Identifier: GPL-3.0-or-later
// CGAL's AABB tree over the triangles that have an area. Built at once with its distance accelerator, so that queries are
// const and may run in parallel. Inside and outside are told by the signed count of crossings, which also holds where
// closed bodies overlap.
#include "planner/geom/mesh_query.hpp"

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Simple_cartesian.h>

#include <algorithm>
#include <vector>

namespace asbuilt {
namespace {

using Kernel = CGAL::Simple_cartesian<double>;
using Point = Kernel::Point_3;
using Triangle = Kernel::Triangle_3;
using Triangles = std::vector<Triangle>;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

Point to_cgal(const Vec3& p) { return {p.x(), p.y(), p.z()}; }
Vec3 from_cgal(const Point& p) { return {p.x(), p.y(), p.z()}; }

// Irregular, so that no ray runs in a plane or through a vertex that a designer would draw.
const Vec3 kVoteDirections[5] = {{0.5372, 0.3181, 0.7812}, {-0.6127, 0.4413, 0.6557}, {0.2839, -0.8173, 0.5014}, {-0.3291, -0.5519,
    -0.7662},
                                 {0.7933, 0.1267, -0.5955}};

}  // namespace

struct MeshQuery::Impl {
  Mesh mesh;
  Triangles triangles;
  std::vector<int> index;  // of each triangle of the tree in the mesh
  Tree tree;

  int mesh_triangle(Triangles::const_iterator it) const { return index[static_cast<std::size_t>(it - triangles.begin())]; }
};

MeshQuery::MeshQuery(Mesh mesh) {
  auto impl = std::make_shared<Impl>();
  impl->mesh = std::move(mesh);
  impl->triangles.reserve(impl->mesh.triangles.size());
  for (std::size_t t = 0; t < impl->mesh.triangles.size(); ++t) {
    const auto& f = impl->mesh.triangles[t];
    const Triangle candidate(to_cgal(impl->mesh.vertices[f[0]]), to_cgal(impl->mesh.vertices[f[1]]), to_cgal(impl->mesh.vertices[f[2]]));
    if (candidate.is_degenerate()) continue;
    impl->triangles.push_back(candidate);
    impl->index.push_back(static_cast<int>(t));
  }
  if (!impl->triangles.empty()) {
    impl->tree.rebuild(impl->triangles.begin(), impl->triangles.end());
    impl->tree.build();
    impl->tree.accelerate_distance_queries();
  }
  impl_ = std::move(impl);
}

const Mesh& MeshQuery::mesh() const {
  static const Mesh empty;
  return impl_ ? impl_->mesh : empty;
}

bool MeshQuery::is_empty() const { return !impl_ || impl_->triangles.empty(); }

MeshHit MeshQuery::closest(const Vec3& p_mm) const {
  if (is_empty()) return {p_mm, -1, 1e300};
  const auto found = impl_->tree.closest_point_and_primitive(to_cgal(p_mm));
  const Vec3 foot = from_cgal(found.first);
  return {foot, impl_->mesh_triangle(found.second), (foot - p_mm).norm()};
}

std::optional<MeshHit> MeshQuery::first_hit(const Vec3& p_mm, const Vec3& d, double reach_mm) const {
  if (is_empty()) return std::nullopt;
  const Kernel::Ray_3 ray(to_cgal(p_mm), Kernel::Vector_3(d.x(), d.y(), d.z()));
  const auto hit = impl_->tree.first_intersection(ray);
  if (!hit) return std::nullopt;
  Vec3 p;
  if (const Point* point = boost::get<Point>(&hit->first)) {
    p = from_cgal(*point);
  } else if (const Kernel::Segment_3* segment = boost::get<Kernel::Segment_3>(&hit->first)) {  // the ray lies in the triangle
    const Vec3 a = from_cgal(segment->source()), b = from_cgal(segment->target());
    p = (a - p_mm).dot(d) < (b - p_mm).dot(d) ? a : b;
  } else {
    return std::nullopt;
  }
  const double along = std::max(0.0, (p - p_mm).dot(d));
  if (along > reach_mm) return std::nullopt;
  return MeshHit{p, impl_->mesh_triangle(hit->second), along};
}

bool MeshQuery::contains(const Vec3& p_mm) const {
  if (is_empty()) return false;
  const CGAL::Bbox_3 box = impl_->tree.bbox();
  if (p_mm.x() < box.xmin() || p_mm.x() > box.xmax() || p_mm.y() < box.ymin() || p_mm.y() > box.ymax() || p_mm.z() < box.zmin() ||
      p_mm.z() > box.zmax())
    return false;
  int votes = 0, asked = 0;
  std::vector<Triangles::const_iterator> crossed;
  for (const Vec3& d : kVoteDirections) {
    crossed.clear();
    impl_->tree.all_intersected_primitives(Kernel::Ray_3(to_cgal(p_mm), Kernel::Vector_3(d.x(), d.y(), d.z())),
        std::back_inserter(crossed));
    int winding = 0;  // a body around p is left once more often than it is entered
    for (const auto it : crossed) {
      const Vec3 a = from_cgal(it->vertex(0)), b = from_cgal(it->vertex(1)), c = from_cgal(it->vertex(2));
      winding += (b - a).cross(c - a).dot(d) > 0 ? 1 : -1;
    }
    votes += winding > 0 ? 1 : 0;
    ++asked;
    if (asked == 2 && votes != 1) break;
  }
  return 2 * votes > asked;
}

double MeshQuery::signed_distance(const Vec3& p_mm) const {
  const double d = closest(p_mm).distance_mm;
  return contains(p_mm) ? -d : d;
}

}  // namespace asbuilt
