// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/tessellated.hpp"

namespace asbuilt::step {

using namespace p21;

namespace {

void read_face(const Binder& b, const Instance& i, TriangleBody& out) {
  const Args a = b.args(i);
  const bool is_face = b.key(i) == K_TRIANGULATED_FACE || b.key(i) == K_COMPLEX_TRIANGULATED_FACE;
  const bool is_strips = b.key(i) == K_COMPLEX_TRIANGULATED_FACE || b.key(i) == K_COMPLEX_TRIANGULATED_SURFACE_SET;
  const std::uint32_t o = is_face ? 5 : 4;  // pnindex: after name, coordinates, pnmax, normals and, for faces, the link
  const std::int64_t list_id = b.reference(i, a.at(1));
  const auto [known, is_new] = out.lists.emplace(list_id, std::pair{static_cast<int>(out.mesh.vertices.size()), 0});
  if (is_new) {
    const Instance& c = b.instance(list_id);
    const Args points = b.list(c, b.args(c, K_COORDINATES_LIST).at(2));
    const Value* row = points.first();
    for (std::uint32_t k = 0; k < points.size(); ++k, row = next(row)) {
      const Args p = b.list(c, row);
      if (p.size() != 3) b.fail(c, "a point with other than 3 coordinates");
      Vec3 v;
      for (std::uint32_t j = 0; j < 3; ++j) v[static_cast<int>(j)] = b.real(c, p.first() + j) * b.units.length_mm;
      if (!(v.cwiseAbs().maxCoeff() <= 1e9)) b.fail(c, "a length beyond 1e9 mm");
      out.mesh.vertices.push_back(v);
    }
    known->second.second = static_cast<int>(points.size());
  }
  const auto [first, count] = known->second;
  std::vector<std::int64_t> index;
  const Args pn = b.list(i, a.at(o));
  for (std::uint32_t k = 0; k < pn.size(); ++k) index.push_back(b.integer(i, pn.first() + k));
  const auto vertex = [&, first = first, count = count](const Value* v) {
    std::int64_t k = b.integer(i, v);
    if (!index.empty()) {
      if (k < 1 || k > static_cast<std::int64_t>(index.size())) b.fail(i, "an index outside its list");
      k = index[static_cast<std::size_t>(k) - 1];
    }
    if (k < 1 || k > count) b.fail(i, "an index outside the coordinates");
    return first + static_cast<int>(k) - 1;
  };
  const int group = static_cast<int>(out.ids.size());
  out.ids.push_back("#" + std::to_string(i.id));
  const auto add = [&](int x, int y, int z) {
    if (x == y || y == z || z == x) return;
    out.mesh.triangles.push_back({x, y, z});
    out.group.push_back(group);
  };
  const Args list = b.list(i, a.at(o + 1));
  const Value* v = list.first();
  for (std::uint32_t k = 0; k < list.size(); ++k, v = next(v)) {
    const Args t = b.list(i, v);
    for (std::uint32_t j = 0; j + 2 < t.size(); ++j) {
      const int x = vertex(t.first() + j), y = vertex(t.first() + j + 1), z = vertex(t.first() + j + 2);
      if (is_strips && j % 2)
        add(y, x, z);
      else
        add(x, y, z);
      if (!is_strips) break;
    }
  }
  if (!is_strips) return;
  const Args fans = b.list(i, a.at(o + 2));
  v = fans.first();
  for (std::uint32_t k = 0; k < fans.size(); ++k, v = next(v)) {
    const Args t = b.list(i, v);
    for (std::uint32_t j = 1; j + 1 < t.size(); ++j) add(vertex(t.first()), vertex(t.first() + j), vertex(t.first() + j + 1));
  }
}

}  // namespace

void read_triangles(const Binder& b, std::int64_t id, TriangleBody& out, std::vector<Unread>& unread, int depth) {
  try {
    const Instance& i = b.instance(id);
    switch (b.key(i)) {
      case K_TESSELLATED_SOLID:
      case K_TESSELLATED_SHELL:
        if (depth > 4) b.fail(i, "tessellated items refer to each other in a circle");
        for (std::int64_t item : b.references(i, b.args(i).at(1))) read_triangles(b, item, out, unread, depth + 1);
        return;
      case K_TRIANGULATED_FACE:
      case K_COMPLEX_TRIANGULATED_FACE:
      case K_TRIANGULATED_SURFACE_SET:
      case K_COMPLEX_TRIANGULATED_SURFACE_SET:
        return read_face(b, i, out);
      default:
        b.fail(i, "a kind of tessellated item that is not known");
    }
  } catch (const StepFault& f) {
    if (unread.size() < 1000) unread.push_back({f.entity, static_cast<int>(f.line), f.text()});
  }
}

}  // namespace asbuilt::step
