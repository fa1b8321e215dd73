// SPDX-License-Identifier: GPL-3.0-or-later
// One body as index arrays: vertices, edges with their curve ranges, loops of edge uses, faces, shells. Body frame, mm.
#pragma once

#include <string>
#include <unordered_map>
#include <vector>

#include "planner/geom/brep.hpp"
#include "planner/io/step/bind.hpp"

namespace asbuilt::step {

struct TopoVertex {
  std::int64_t id = 0;
  Vec3 p = Vec3::Zero();
};

struct TopoEdge {
  std::int64_t id = 0;
  std::uint32_t line = 0;
  int v0 = -1, v1 = -1;
  Curve curve;
  double t0 = 0, t1 = 0;   // curve parameters at v0 and v1; t1 < t0 when the edge runs against the curve
  bool is_closed = false;  // v0 == v1
  bool is_point = false;   // closed and of no length: a pole or an apex
  bool is_chord = false;   // the curve could not be read: a straight stand-in
  std::string fault;
  std::vector<double> t_extra;             // asked for where two borders of a face run closer than their chords
  std::vector<double> t;                   // mesh samples, t.front() == t0, t.back() == t1
  std::vector<int> vertex;                 // their mesh vertices
  std::vector<std::pair<int, bool>> uses;  // face, forward with respect to the outward normal of that face
};

struct EdgeUse {
  int edge = -1;
  bool is_forward = true;
};

struct TopoLoop {
  std::int64_t id = 0;
  std::vector<EdgeUse> uses;  // interior on the left seen from outside
  int vertex = -1;            // a vertex loop
};

struct TopoFace {
  std::int64_t id = 0;
  std::uint32_t line = 0;
  int surface = -1;        // -1: not readable
  bool same_sense = true;  // outward normal against the natural normal
  int shell = 0;
  std::vector<TopoLoop> loops;
  std::string fault;
};

struct TopoShell {
  std::int64_t id = 0;
  bool is_closed = true;
  bool is_void = false;
  std::vector<int> faces;
};

struct Body {
  std::int64_t id = 0;
  std::uint32_t line = 0;
  bool is_solid = false;
  std::vector<TopoVertex> vertices;
  std::vector<TopoEdge> edges;
  std::vector<Surface> surfaces;
  std::vector<SurfaceDomain> domains;
  std::vector<TopoFace> faces;
  std::vector<TopoShell> shells;
};

/// Reads MANIFOLD_SOLID_BREP, BREP_WITH_VOIDS, FACETED_BREP, SHELL_BASED_SURFACE_MODEL, FACE_BASED_SURFACE_MODEL, a shell or a
/// face. What cannot be read goes to `unread` and to the faults of the faces.
Body read_body(const Binder& b, std::int64_t id, std::vector<Unread>& unread);

/// The loops of a face and its edge uses the other way round.
void reverse_loops(Body& body, int face);
/// Turns a shell inside out: senses of faces, loops and edge uses.
void reverse_shell(Body& body, int shell);

}  // namespace asbuilt::step
