// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/step_reader.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <unordered_map>

#include "planner/geom/mesh_brep.hpp"
#include "planner/io/step/classify.hpp"
#include "planner/io/step/model.hpp"
#include "planner/io/step/pmi.hpp"
#include "planner/io/step/style.hpp"
#include "planner/io/step/tessellate.hpp"
#include "planner/io/step/tessellated.hpp"

namespace asbuilt {
namespace {

using namespace step;

constexpr double kPlacedFacesLimit = 1e6;

/// Appends one placed body to the part.
void place(const Body& body, const BodyMesh& mesh, const std::vector<BrepEdge>& edges, const BodyUse& use, int nth, const Styles& styles,
           Brep& out) {
  const Eigen::Affine3d& T = use.T_root_body;
  const int face_0 = static_cast<int>(out.faces.size());
  const int vertex_0 = static_cast<int>(out.mesh.vertices.size()), body_index = static_cast<int>(out.bodies.size());
  const std::string suffix = nth > 1 ? ":" + std::to_string(nth) : "";
  const auto style_of = [](const auto& map, std::initializer_list<std::int64_t> ids) {
    for (std::int64_t id : ids)
      if (const auto it = map.find(id); it != map.end()) return it->second;
    return std::string();
  };
  const std::int64_t shell_id = body.shells.empty() ? 0 : body.shells.front().id;
  out.bodies.push_back({"#" + std::to_string(body.id) + suffix, use.name, use.instance,
                        style_of(styles.color, {body.id, shell_id, use.representation}),
                        style_of(styles.layer, {body.id, shell_id, use.representation}), body.is_solid});
  const double scale = std::cbrt(std::abs(T.linear().determinant()));
  const bool is_mirror = T.linear().determinant() < 0;
  const Mat3 R = T.linear() / (scale > 0 ? scale : 1);
  const bool is_identity = T.matrix() == Eigen::Matrix4d::Identity();
  for (std::size_t k = 0; k < body.faces.size(); ++k) {
    const TopoFace& f = body.faces[k];
    BrepFace b;
    b.id = "#" + std::to_string(f.id) + suffix;
    b.color = style_of(styles.color, {f.id});
    if (b.color.empty()) b.color = out.bodies.back().color;
    b.same_sense = f.same_sense;
    b.body = body_index;
    b.fault = f.fault;
    if (f.surface >= 0) {
      bool is_reversed = false;
      const Surface& s = body.surfaces[static_cast<std::size_t>(f.surface)];
      b.surface = is_identity ? s : transformed(T, s, is_reversed);
      if (is_reversed) b.same_sense = !b.same_sense;
    }
    b.area_mm2 = mesh.area_mm2.empty() ? 0 : mesh.area_mm2[k] * scale * scale;
    out.area_mm2 += b.area_mm2;
    if (body.is_solid && !mesh.volume_mm3.empty()) out.volume_mm3 += mesh.volume_mm3[k] * scale * scale * scale;
    out.faces.push_back(std::move(b));
  }
  for (BrepEdge e : edges) {
    e.id += suffix;
    for (int* f : {&e.face_1, &e.face_2})
      if (*f >= 0) {
        *f += face_0;
        auto& list = out.faces[static_cast<std::size_t>(*f)].edges;
        if (list.empty() || list.back() != static_cast<int>(out.edges.size())) list.push_back(static_cast<int>(out.edges.size()));
      }
    if (!is_identity) {
      e.curve = transformed(T, e.curve);
      for (Vec3& p : e.p) p = T * p;
      for (double& s : e.s_mm) s *= scale;
      e.length_mm *= scale;
      for (auto* v : {&e.tangent, &e.n_1, &e.n_2})
        for (Vec3& d : *v) d = R * d;
      if (is_mirror) {  // seen from outside the walk is reversed
        for (auto* v : {&e.p, &e.tangent, &e.n_1, &e.n_2}) std::reverse(v->begin(), v->end());
        for (Vec3& d : e.tangent) d = -d;
        for (double& s : e.s_mm) s = e.length_mm - s;
        std::reverse(e.s_mm.begin(), e.s_mm.end());
      }
    }
    out.edges.push_back(std::move(e));
  }
  for (const Vec3& v : mesh.vertices) out.mesh.vertices.push_back(is_identity ? v : T * v);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    auto tri = mesh.triangles[t];
    if (is_mirror) std::swap(tri[1], tri[2]);
    for (int& v : tri) {
      v += vertex_0;
      out.faces[static_cast<std::size_t>(face_0 + mesh.face[t])].box.extend(out.mesh.vertices[static_cast<std::size_t>(v)]);
    }
    out.mesh.triangles.push_back(tri);
    out.triangle_face.push_back(face_0 + mesh.face[t]);
  }
  if (body.is_solid)
    ++out.solids_count;
  else
    out.shells_count += static_cast<int>(body.shells.size());
}

/// Closed shells whose volume has the wrong sign are turned inside out.
bool orient_shells(Body& body, BodyMesh& mesh, std::vector<Note>& notes, const std::string& name) {
  bool turned = false;
  for (std::size_t s = 0; s < body.shells.size(); ++s) {
    if (!body.is_solid) continue;
    double volume = 0;
    for (int f : body.shells[s].faces) volume += mesh.volume_mm3[static_cast<std::size_t>(f)];
    if ((volume < 0) == body.shells[s].is_void) continue;
    reverse_shell(body, static_cast<int>(s));
    for (int f : body.shells[s].faces) mesh.volume_mm3[static_cast<std::size_t>(f)] *= -1;
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
      if (body.faces[static_cast<std::size_t>(mesh.face[t])].shell == static_cast<int>(s))
        std::swap(mesh.triangles[t][1], mesh.triangles[t][2]);
    notes.push_back({Note::Level::warning, "step.shell_turned", "a closed shell was inside out and has been turned",
                     name + ": #" + std::to_string(body.shells[s].id)});
    turned = true;
  }
  return turned;
}

/// Removes vertices no triangle uses.
void drop_unused_vertices(Mesh& m) {
  std::vector<int> to(m.vertices.size(), -1);
  for (const auto& t : m.triangles)
    for (int v : t) to[static_cast<std::size_t>(v)] = 0;
  std::size_t n = 0;
  for (std::size_t i = 0; i < to.size(); ++i)
    if (to[i] == 0) to[i] = static_cast<int>(n), m.vertices[n++] = m.vertices[i];
  m.vertices.resize(n);
  for (auto& t : m.triangles)
    for (int& v : t) v = to[static_cast<std::size_t>(v)];
}

/// A file whose only bodies are triangles: every triangulated face is a face, edges where faces meet.
Result<Done<Brep>> from_triangles(Binder& binder, const Model& model, const std::string& name, Done<Brep> done) {
  TriangleBody all;
  const auto is_solid = [&](const BodyUse& u) { return binder.key(binder.instance(u.body)) == p21::K_TESSELLATED_SOLID; };
  const bool has_solids = std::any_of(model.tessellated.begin(), model.tessellated.end(), is_solid);
  int solids = 0;
  for (const BodyUse& use : model.tessellated) {
    if (has_solids && !is_solid(use)) continue;  // loose shells beside solids are construction
    binder.units = use.units;
    TriangleBody one;
    read_triangles(binder, use.body, one, done.artefact.unread);
    const int first = static_cast<int>(all.mesh.vertices.size()), first_id = static_cast<int>(all.ids.size());
    for (const Vec3& v : one.mesh.vertices) all.mesh.vertices.push_back(use.T_root_body * v);
    for (auto t : one.mesh.triangles) {
      if (use.T_root_body.linear().determinant() < 0) std::swap(t[1], t[2]);
      all.mesh.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
    }
    for (int g : one.group) all.group.push_back(g + first_id);
    all.ids.insert(all.ids.end(), one.ids.begin(), one.ids.end());
    solids += has_solids;
  }
  if (all.mesh.triangles.empty())
    return refuse({.code = "step.no_body",
                   .where = name + ":1",
                   .message = "the tessellated bodies hold no triangles; export the part as a solid",
                   .stage = "input"});
  Brep b = brep_from_mesh(all.mesh, all.group, all.ids);
  if (solids > 0) b.solids_count = solids, b.shells_count = 0;
  const BodyUse& first = model.tessellated.front();
  b.bodies = {{"#" + std::to_string(first.body), first.name, first.instance, "", "", b.solids_count > 0}};
  b.schema = done.artefact.schema, b.units = done.artefact.units, b.unread = std::move(done.artefact.unread);
  b.pmi = std::move(done.artefact.pmi);
  done.artefact = std::move(b);
  done.notes.push_back({Note::Level::warning, "step.tessellated", "the file holds triangles only: surfaces are fitted, not exact", name});
  return done;
}

Box3 outline_of(const Body& body) {
  Box3 box;
  for (const TopoVertex& v : body.vertices) box.extend(v.p);
  for (const TopoEdge& e : body.edges)
    if (e.is_closed)
      for (int k = 1; k < 4; ++k) box.extend(evaluate(e.curve, e.t0 + (e.t1 - e.t0) * k / 4).p);
  for (const TopoFace& f : body.faces) {  // whole spheres, tori and the like have no edge to show their size
    if (f.surface < 0 || std::any_of(f.loops.begin(), f.loops.end(), [](const TopoLoop& l) { return !l.uses.empty(); })) continue;
    const SurfaceDomain& d = body.domains[static_cast<std::size_t>(f.surface)];
    if (!(d.u1 - d.u0 < 1e200 && d.v1 - d.v0 < 1e200)) continue;
    for (int i = 0; i <= 8; ++i)
      for (int j = 0; j <= 8; ++j)
        box.extend(
            evaluate_jet(body.surfaces[static_cast<std::size_t>(f.surface)], d.u0 + (d.u1 - d.u0) * i / 8, d.v0 + (d.v1 - d.v0) * j / 8, 1)
                .p);
  }
  return box;
}

}  // namespace

Result<Done<Brep>> read_step(std::string_view bytes, const std::string& name, const StepOptions& options) {
  auto lap = [last = std::chrono::steady_clock::now()]() mutable {
    const auto before = std::exchange(last, std::chrono::steady_clock::now());
    return std::chrono::duration<double>(last - before).count();
  };
  StepTiming timing;
  p21::File file;
  if (const auto failure = p21::parse(bytes, file))
    return refuse({.code = failure->code,
                   .where = name + ":" + std::to_string(failure->line),
                   .message = failure->what + "; export the part again as STEP AP214 or AP242",
                   .stage = "input"});
  timing.parse_s = lap();
  Done<Brep> done;
  Brep& out = done.artefact;
  for (std::size_t k = 0; k < file.schema.size(); ++k) out.schema += (k ? ", " : "") + file.schema[k];
  for (const p21::Fault& f : file.faults) {
    const p21::Instance* i = f.id ? file.find(f.id) : nullptr;
    const std::string entity =
        i && i->record_count ? std::string(file.keyword_name(file.records[i->record].keyword)) : std::string("syntax");
    out.unread.push_back({entity, static_cast<int>(f.line), StepFault{f.line, f.id, entity, f.what}.text()});
  }
  Binder binder(file);
  Model model = read_model(binder, out.unread);
  out.units = model.units.name;
  out.pmi = read_pmi(binder);
  const Styles styles = read_styles(binder);
  if (model.is_cut)
    return refuse(
        {.code = "step.limits",
         .where = name + ":1",
         .message =
             "the assembly places more than 100000 products or bodies, or nests deeper than 64; export the part that is worked on alone",
         .measured = static_cast<double>(model.bodies.size()),
         .limit = 100000,
         .unit = "bodies",
         .stage = "input"});

  std::vector<std::pair<std::int64_t, Body>> bodies;
  std::unordered_map<std::int64_t, std::vector<const BodyUse*>> uses_of;
  double diagonal = 0;
  for (const BodyUse& use : model.bodies) {
    auto& uses = uses_of[use.body];
    uses.push_back(&use);
    if (uses.size() > 1) continue;
    binder.units = use.units;
    bodies.emplace_back(use.body, read_body(binder, use.body, out.unread));
    diagonal = std::max(diagonal, outline_of(bodies.back().second).diagonal_mm());
  }
  std::size_t faces = 0;
  for (const auto& [id, b] : bodies) faces += b.faces.size();
  if (faces == 0 && !model.tessellated.empty()) return from_triangles(binder, model, name, std::move(done));
  if (faces == 0) {
    std::string what = "the file holds no body with faces";
    if (!out.unread.empty()) what += " that can be read (" + out.unread.front().why + ")";
    if (!model.external.empty()) what += "; its geometry is in other files (" + model.external.front() + ")";
    return refuse(
        {.code = "step.no_body", .where = name + ":1", .message = what + "; export the part as a solid in one file", .stage = "input"});
  }
  Tolerance tolerance;
  tolerance.chord_mm = options.chord_mm > 0 ? options.chord_mm : std::clamp(1e-4 * diagonal, 0.001, 0.02);
  tolerance.chord_mm = std::max(tolerance.chord_mm, 5e-6 * diagonal);
  tolerance.angle_rad = options.angle_rad > 0 ? options.angle_rad : 0.1745;

  timing.topology_s = lap();
  // How much would be placed, before any of it is made.
  double samples = 0, placed_faces = 0;
  for (auto& [id, body] : bodies) {
    double length = 0;
    for (const TopoEdge& e : body.edges)
      length += 9 + (evaluate(e.curve, e.t1).p - evaluate(e.curve, e.t0).p).norm() +
                (e.is_closed ? 4 * (evaluate(e.curve, 0.5 * (e.t0 + e.t1)).p - evaluate(e.curve, e.t0).p).norm() : 0);
    const double uses = static_cast<double>(uses_of[id].size());
    samples += uses * length / std::max(options.edge_step_mm, 1e-3);
    placed_faces += uses * static_cast<double>(body.faces.size());
  }
  if (placed_faces > kPlacedFacesLimit)
    return refuse({.code = "step.limits",
                   .where = name + ":1",
                   .message = "the assembly places more faces than the reader takes; export the part that is worked on alone",
                   .measured = placed_faces,
                   .limit = kPlacedFacesLimit,
                   .unit = "faces",
                   .stage = "input"});
  const double edge_step_mm = std::max(options.edge_step_mm, 1e-3) * std::max(1.0, samples / 2e5);

  double chord_max_mm = tolerance.chord_mm;
  for (auto& [id, body] : bodies) {
    BodyMesh mesh;
    if (options.want_mesh) {
      mesh = tessellate(body, tolerance);
      orient_shells(body, mesh, done.notes, name);
      chord_max_mm = std::max(chord_max_mm, mesh.chord_max_mm);
    }
    timing.mesh_s += lap();
    const std::vector<BrepEdge> edges = classify_edges(body, edge_step_mm, rad_from_deg(10));
    timing.topology_s += lap();
    int nth = 0;
    for (const BodyUse* use : uses_of[id]) place(body, mesh, edges, *use, ++nth, styles, out);
  }
  drop_unused_vertices(out.mesh);
  for (const BrepEdge& e : out.edges)
    for (const Vec3& p : e.p) out.box.extend(p);
  if (!options.want_mesh)  // faces without edges
    for (const auto& [id, body] : bodies) {
      const Box3 box = outline_of(body);
      for (const BodyUse* use : uses_of[id])
        for (int k = 0; k < 8 && !box.is_empty(); ++k)
          out.box.extend(use->T_root_body * Vec3(k & 1 ? box.max_mm.x() : box.min_mm.x(), k & 2 ? box.max_mm.y() : box.min_mm.y(),
                                                 k & 4 ? box.max_mm.z() : box.min_mm.z()));
    }
  for (const Vec3& v : out.mesh.vertices) out.box.extend(v);
  out.chord_max_mm = chord_max_mm;
  if (chord_max_mm > tolerance.chord_mm)
    done.notes.push_back({Note::Level::warning, "step.chord_not_held",
                          "the mesh would need too many points: its chords leave the surfaces by up to " + std::to_string(chord_max_mm) +
                              " mm, asked were " + std::to_string(tolerance.chord_mm) + " mm",
                          name});
  out.open_edges_count = count_open_edges(out.mesh.triangles);
  timing.mesh_s += lap();
  if (options.timing) *options.timing = timing;
  return done;
}

}  // namespace asbuilt
