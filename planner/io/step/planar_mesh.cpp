// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/planar_mesh.hpp"

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_face_base_with_info_2.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <unordered_map>

namespace asbuilt::step {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
struct Index {  // point index plus one; 0: made by the triangulation
  int k = 0;
};
using VertexBase = CGAL::Triangulation_vertex_base_with_info_2<Index, Kernel>;
using FaceBase = CGAL::Triangulation_face_base_with_info_2<int, Kernel, CGAL::Constrained_triangulation_face_base_2<Kernel>>;
using Structure = CGAL::Triangulation_data_structure_2<VertexBase, FaceBase>;
using Cdt = CGAL::Constrained_Delaunay_triangulation_2<Kernel, Structure, CGAL::Exact_predicates_tag>;

std::uint64_t key_of(int a, int b) {
  if (a > b) std::swap(a, b);
  return static_cast<std::uint64_t>(static_cast<std::uint32_t>(a)) << 32 | static_cast<std::uint32_t>(b);
}

}  // namespace

struct PlanarMesh::Impl {
  Cdt cdt;
  std::vector<Cdt::Vertex_handle> handles;
  std::unordered_map<std::uint64_t, int> count;  // how often a segment was given
  Cdt::Face_handle hint;

  /// Levels: 0 outside, then by parity of crossed segments.
  void mark() {
    for (auto f = cdt.all_faces_begin(); f != cdt.all_faces_end(); ++f) f->info() = -1;
    std::vector<Cdt::Face_handle> stack{cdt.infinite_face()};
    cdt.infinite_face()->info() = 0;
    while (!stack.empty()) {
      const Cdt::Face_handle f = stack.back();
      stack.pop_back();
      for (int k = 0; k < 3; ++k) {
        const Cdt::Face_handle n = f->neighbor(k);
        if (n->info() >= 0) continue;
        int level = f->info();
        if (f->is_constrained(k)) {
          const auto it = count.find(key_of(f->vertex(Cdt::ccw(k))->info().k, f->vertex(Cdt::cw(k))->info().k));
          if (it == count.end() || it->second % 2 == 1) level ^= 1;
        }
        n->info() = level;
        stack.push_back(n);
      }
    }
  }
};

PlanarMesh::PlanarMesh() : impl_(std::make_unique<Impl>()) {}
PlanarMesh::~PlanarMesh() = default;

int PlanarMesh::build(const std::vector<Vec2>& points, const std::vector<std::array<int, 2>>& segments) {
  Impl& m = *impl_;
  int faults = 0;
  m.handles.resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto h = m.cdt.insert(Kernel::Point_2(points[i].x(), points[i].y()), m.hint);
    if (h->info().k != 0) {
      ++faults;  // coincides with an earlier point (indices are stored plus one)
    } else {
      h->info().k = static_cast<int>(i) + 1;
    }
    m.handles[i] = h;
    m.hint = h->face();
  }
  const std::size_t vertices_before = m.cdt.number_of_vertices();
  for (const auto& s : segments) {
    const auto a = m.handles[static_cast<std::size_t>(s[0])], b = m.handles[static_cast<std::size_t>(s[1])];
    if (a == b) continue;
    if (++m.count[key_of(a->info().k, b->info().k)] > 1) continue;
    m.cdt.insert_constraint(a, b);
  }
  m.hint = m.handles.empty() ? Cdt::Face_handle() : m.handles[0]->face();  // constraints remove faces
  const std::size_t added = m.cdt.number_of_vertices() - vertices_before;
  faults += static_cast<int>(added);
  if (added)
    for (auto v = m.cdt.finite_vertices_begin(); v != m.cdt.finite_vertices_end(); ++v)
      if (v->info().k == 0) m.handles.push_back(v), v->info().k = static_cast<int>(m.handles.size());
  for (const auto& [key, n] : m.count) {  // split by a point that lies on the segment
    const auto a = m.handles[static_cast<std::size_t>(key >> 32) - 1], b = m.handles[static_cast<std::size_t>(key & 0xffffffffu) - 1];
    if (!m.cdt.is_edge(a, b)) ++faults;
  }
  return faults;
}

Vec2 PlanarMesh::point(int index) const {
  const auto& p = impl_->handles[static_cast<std::size_t>(index)]->point();
  return {p.x(), p.y()};
}
int PlanarMesh::size() const { return static_cast<int>(impl_->handles.size()); }

PlanarMesh::Inside PlanarMesh::inside() {
  Impl& m = *impl_;
  m.mark();
  Inside out;
  if (m.cdt.dimension() < 2) return out;
  for (auto f = m.cdt.finite_faces_begin(); f != m.cdt.finite_faces_end(); ++f) {
    if (f->info() != 1) continue;
    out.triangles.push_back({f->vertex(0)->info().k - 1, f->vertex(1)->info().k - 1, f->vertex(2)->info().k - 1});
    out.is_border.push_back({f->is_constrained(2), f->is_constrained(0), f->is_constrained(1)});
  }
  return out;
}

std::vector<Vec2> PlanarMesh::filter_inside(const std::vector<Vec2>& points, double gap) {
  Impl& m = *impl_;
  m.mark();
  std::vector<Vec2> out;
  Cdt::Face_handle hint;
  for (const Vec2& q : points) {
    const Kernel::Point_2 p(q.x(), q.y());
    Cdt::Locate_type type;
    int index = 0;
    const Cdt::Face_handle f = m.cdt.locate(p, type, index, hint);
    if (type != Cdt::FACE && type != Cdt::EDGE) continue;
    hint = f;
    if (f->info() != 1) continue;
    bool ok = true;
    for (int k = 0; k < 3 && ok; ++k) {
      ok = CGAL::squared_distance(p, f->vertex(k)->point()) > gap * gap;
      if (ok && f->is_constrained(k))
        ok = CGAL::squared_distance(p, Kernel::Segment_2(f->vertex(Cdt::ccw(k))->point(), f->vertex(Cdt::cw(k))->point())) >
             0.25 * gap * gap;
    }
    if (ok) out.push_back(q);
  }
  return out;
}

std::vector<int> PlanarMesh::insert(const std::vector<Vec2>& points) {
  Impl& m = *impl_;
  std::vector<int> out;
  for (const Vec2& q : points) {
    const Kernel::Point_2 p(q.x(), q.y());
    Cdt::Locate_type type;
    int index = 0;
    const Cdt::Face_handle f = m.cdt.locate(p, type, index, m.hint);
    if (type == Cdt::VERTEX || (type == Cdt::EDGE && f->is_constrained(index)) || type == Cdt::OUTSIDE_CONVEX_HULL ||
        type == Cdt::OUTSIDE_AFFINE_HULL) {
      out.push_back(-1);
      continue;
    }
    const auto h = m.cdt.insert(p, type, f, index);
    m.handles.push_back(h);
    h->info().k = static_cast<int>(m.handles.size());
    m.hint = h->face();
    out.push_back(static_cast<int>(m.handles.size()) - 1);
  }
  return out;
}

}  // namespace asbuilt::step
