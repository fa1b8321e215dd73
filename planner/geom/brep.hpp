// SPDX-License-Identifier: GPL-3.0-or-later
// What CAD says the part is: faces with exact surfaces, edges with their two faces, a watertight mesh. Frame: part. mm, rad.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "planner/geom/surface.hpp"

namespace asbuilt {

/// Angle between the outward normals: smooth < 1 deg, near 1..10, sharp from 10. convex: material angle below 180.
enum class EdgeKind { sharp_convex, sharp_concave, near_tangent, smooth, boundary, mixed, nonmanifold };
std::string_view name_of(EdgeKind k);  // "sharp_convex", "sharp_concave", "near", "smooth", "boundary", "mixed", "nonmanifold"

/// A solid or a sheet where it is placed. A body placed more than once gives its faces and edges ids of their own: "#417", "#417:2", ...
struct BrepBody {
  std::string id;            // "#17"
  std::string product;       // name of the product it belongs to
  std::string instance;      // names of the usages that place it, from the root: "gearbox/left cover"; empty for the root itself
  std::string color, layer;  // "#rrggbb" and the layer's name, where the file gives them
  bool is_solid = true;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("id", s.id), a("product", s.product), a("instance", s.instance), a("color", s.color), a("layer", s.layer), a("is_solid", s.is_solid);
  }
};

struct BrepFace {
  std::string id;  // "#417"; the triangle group's name for a mesh part
  Surface surface;
  bool same_sense = true;  // outward normal = natural normal, negated when false
  int body = 0;            // index into Brep::bodies
  std::vector<int> edges;  // indices into Brep::edges
  double area_mm2 = 0;
  Box3 box;
  std::string color;  // "#rrggbb", its own or its body's; empty: none given
  std::string fault;  // empty: exact; else what could not be read or was repaired
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("id", s.id), a("surface", s.surface), a("same_sense", s.same_sense), a("body", s.body), a("edges", s.edges);
    a("area", s.area_mm2), a("box", s.box), a("color", s.color), a("fault", s.fault);
  }
};

/// Samples run along the edge, at least every mm and every 10 degrees; arrays are parallel. A closed edge repeats its first point at
/// the end. The walk is the one of face_1 (its interior on the left, seen from outside): the direction into face_1 is
/// n_1 x tangent, into face_2 tangent x n_2, and (n_1 x n_2) . tangent > 0 on a convex edge.
struct BrepEdge {
  std::string id;                // "#88"
  int face_1 = -1, face_2 = -1;  // indices into Brep::faces; -1: none
  EdgeKind kind = EdgeKind::smooth;
  bool is_closed = false;
  bool is_seam = false;  // both sides are the same smooth face; not counted as an edge
  double length_mm = 0;
  double dihedral_rad = 0;  // median angle between the outward normals
  std::string curve_type;   // "line", "circle", ...
  Curve curve;
  std::vector<double> s_mm;                // arc length at the samples
  std::vector<Vec3> p, tangent, n_1, n_2;  // point, unit tangent, outward unit normals of face_1 and face_2
  std::string fault;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("id", s.id), a("face_1", s.face_1), a("face_2", s.face_2), a("kind", s.kind), a("is_closed", s.is_closed);
    a("is_seam", s.is_seam), a("length", s.length_mm), a("dihedral", s.dihedral_rad), a("curve_type", s.curve_type);
    a("curve", s.curve), a("s", s.s_mm), a("p", s.p), a("tangent", s.tangent), a("n_1", s.n_1), a("n_2", s.n_2);
    a("fault", s.fault);
  }
};

/// Kind from the outward normals along an edge, with the walk of face_1. The kind is what the edge is at its sharpest (98 % of its
/// length), the dihedral angle the median along the length.
EdgeKind edge_kind(const std::vector<double>& s_mm, const std::vector<Vec3>& tangent, const std::vector<Vec3>& n_1,
                   const std::vector<Vec3>& n_2, double& dihedral_rad);

struct Unread {  // something the file uses and we do not know
  std::string entity;
  int line = 0;
  std::string why;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("entity", s.entity), a("line", s.line), a("why", s.why);
  }
};

struct Brep {
  std::string schema, units;  // of the file; everything here is mm
  int solids_count = 0, shells_count = 0;
  std::vector<BrepBody> bodies;
  std::vector<BrepFace> faces;
  std::vector<BrepEdge> edges;
  Mesh mesh;                            // chord tolerance as asked; triangles point outward
  std::vector<int> triangle_face;       // face of each triangle
  double area_mm2 = 0, volume_mm3 = 0;  // of the exact surfaces where they are known; volume of solids
  Box3 box;
  int open_edges_count = 0;
  double chord_max_mm = 0;
  std::vector<Unread> unread;
  std::vector<std::string> pmi;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("schema", s.schema), a("units", s.units), a("solids", s.solids_count), a("shells", s.shells_count), a("bodies", s.bodies);
    a("faces", s.faces);
    a("edges", s.edges), a("mesh", s.mesh), a("triangle_face", s.triangle_face), a("area", s.area_mm2), a("volume", s.volume_mm3);
    a("box", s.box), a("open_edges", s.open_edges_count), a("chord_max", s.chord_max_mm), a("unread", s.unread), a("pmi", s.pmi);
  }
};

}  // namespace asbuilt
