// SPDX-License-Identifier: GPL-3.0-or-later
// cad: what the reader sees of a file (cad/1 of the contract). Everything in mm and degree.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <filesystem>

#include "planner/app/commands.hpp"
#include "planner/base/number.hpp"
#include "planner/geom/edge_chains.hpp"
#include "planner/io/file.hpp"
#include "planner/io/mesh_file.hpp"
#include "planner/io/step/step_reader.hpp"

namespace asbuilt {

namespace {

std::string lower_extension(const std::string& name) {
  std::string end = std::filesystem::path(name).extension().string();
  std::transform(end.begin(), end.end(), end.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return end;
}

Json vec(const Vec3& v) { return Json::array({rounded(v.x(), 6), rounded(v.y(), 6), rounded(v.z(), 6)}); }

double fixed(double v) { return std::isfinite(v) ? rounded(v, 6) : 0.0; }

const char* const kKinds[] = {"sharp_convex", "sharp_concave", "near", "smooth", "boundary"};

Json cad_json(const Brep& b, const StepTiming& timing, bool wants_edges) {
  Json j{{"asbuilt", "cad/1"},       {"schema", b.schema},       {"units", b.units},
         {"solids", b.solids_count}, {"shells", b.shells_count}, {"faces", b.faces.size()}};
  Json& by = j["faces_by_surface"] = Json::object();
  for (const char* name : {"plane", "cylinder", "cone", "sphere", "torus", "bspline", "revolution", "extrusion", "offset"})
    by[name] = {{"count", 0}, {"area", 0.0}};
  for (const BrepFace& f : b.faces) {
    Json& row = by[std::string(surface_type(f.surface))];
    if (row.is_null()) row = {{"count", 0}, {"area", 0.0}};
    row["count"] = row["count"].get<int>() + 1;
    row["area"] = row["area"].get<double>() + f.area_mm2;
  }
  for (auto& [name, row] : by.items()) row["area"] = fixed(row["area"].get<double>());
  j["area"] = fixed(b.area_mm2);
  j["volume"] = fixed(b.volume_mm3);
  j["box"] = b.box.is_empty() ? Json(nullptr) : Json{{"min", vec(b.box.min_mm)}, {"max", vec(b.box.max_mm)}};
  Json count = Json::object(), length = Json::object();
  for (const char* kind : kKinds) count[kind] = 0, length[kind] = 0.0;
  for (const BrepEdge& e : b.edges) {
    if (e.is_seam) continue;
    const std::string kind(name_of(e.kind));
    count[kind] = count.value(kind, 0) + 1;
    length[kind] = length.value(kind, 0.0) + e.length_mm;
  }
  for (auto& [kind, l] : length.items()) l = fixed(l.get<double>());
  j["edges"] = {{"count", std::move(count)}, {"length", std::move(length)}};
  j["bodies"] = Json::array();
  std::vector<std::size_t> faces_of(b.bodies.size(), 0);
  std::vector<double> area_of(b.bodies.size(), 0.0);
  Json colors = Json::object();
  for (const BrepFace& f : b.faces) {
    const auto k = static_cast<std::size_t>(f.body);
    if (k < faces_of.size()) ++faces_of[k], area_of[k] += f.area_mm2;
    if (!f.color.empty()) colors[f.color] = colors.value(f.color, 0) + 1;
  }
  for (std::size_t k = 0; k < b.bodies.size(); ++k) {
    const BrepBody& o = b.bodies[k];
    j["bodies"].push_back({{"id", o.id},
                           {"product", o.product},
                           {"instance", o.instance},
                           {"color", o.color},
                           {"layer", o.layer},
                           {"solid", o.is_solid},
                           {"faces", faces_of[k]},
                           {"area", fixed(area_of[k])}});
  }
  j["faces_by_color"] = std::move(colors);
  j["chains"] = Json::array();
  for (const EdgeChain& c : edge_chains(b)) {
    if (c.edges.size() < 2 && !c.is_closed) continue;
    Json ids = Json::array();
    for (const int e : c.edges) ids.push_back(b.edges[static_cast<std::size_t>(e)].id);
    j["chains"].push_back({{"id", c.id},
                           {"kind", std::string(name_of(c.kind))},
                           {"edges", std::move(ids)},
                           {"length", fixed(c.length_mm)},
                           {"closed", c.is_closed}});
  }
  j["mesh"] = {{"triangles", b.mesh.triangles.size()},
               {"vertices", b.mesh.vertices.size()},
               {"open_edges", b.open_edges_count},
               {"chord_max", fixed(b.chord_max_mm)}};
  j["unread"] = Json::array();
  for (const Unread& u : b.unread) j["unread"].push_back({{"entity", u.entity}, {"line", u.line}, {"why", u.why}});
  j["pmi"] = b.pmi;
  if (wants_edges) {
    j["edge_list"] = Json::array();
    for (const BrepEdge& e : b.edges) {
      if (e.is_seam) continue;
      Json faces = Json::array(), p = Json::array();
      for (const int f : {e.face_1, e.face_2})
        if (f >= 0) faces.push_back(b.faces[static_cast<std::size_t>(f)].id);
      for (const Vec3& v : e.p) p.push_back(vec(v));
      j["edge_list"].push_back({{"id", e.id},
                                {"faces", std::move(faces)},
                                {"kind", std::string(name_of(e.kind))},
                                {"length", fixed(e.length_mm)},
                                {"dihedral", fixed(deg_from_rad(e.dihedral_rad))},
                                {"curve", e.curve_type},
                                {"closed", e.is_closed},
                                {"points", std::move(p)}});
    }
  }
  j["timing_s"] = {{"parse", rounded(timing.parse_s, 4)}, {"topology", rounded(timing.topology_s, 4)}, {"mesh", rounded(timing.mesh_s, 4)}};
  return j;
}

std::string cad_text(const Json& j, const std::string& file) {
  std::string text = fmt::format("{}: {}, units {}\n{} solids, {} shells, {} faces, area {} mm2, volume {} mm3\n", file,
                                 j["schema"].get<std::string>(), j["units"].get<std::string>(), j["solids"].get<int>(),
                                 j["shells"].get<int>(), j["faces"].get<int>(), fixed_number(j["area"], 3), fixed_number(j["volume"], 3));
  if (!j["box"].is_null()) text += fmt::format("box {} to {} mm\n", j["box"]["min"].dump(), j["box"]["max"].dump());
  std::vector<std::vector<std::string>> rows{{"surface", "faces", "area mm2"}};
  for (const auto& [name, row] : j["faces_by_surface"].items())
    if (row["count"] != 0) rows.push_back({name, row["count"].dump(), fixed_number(row["area"], 3)});
  text += text_table(rows);
  rows = {{"edges", "count", "length mm"}};
  for (const auto& [kind, count] : j["edges"]["count"].items())
    if (count != 0) rows.push_back({kind, count.dump(), fixed_number(j["edges"]["length"][kind], 3)});
  text += text_table(rows);
  rows = {{"body", "product", "instance", "color", "layer", "faces"}};
  for (const Json& o : j["bodies"]) rows.push_back({o["id"], o["product"], o["instance"], o["color"], o["layer"], o["faces"].dump()});
  if (rows.size() > 1) text += text_table(rows);
  text += fmt::format("chains: {} of more than one edge or closed\n", j["chains"].size());
  text += fmt::format("mesh: {} triangles, {} open edges, chord {} mm\n", j["mesh"]["triangles"].dump(), j["mesh"]["open_edges"].dump(),
                      j["mesh"]["chord_max"].dump());
  for (const Json& u : j["unread"]) text += fmt::format("not read: line {}: {}\n", u["line"].dump(), u["why"].get<std::string>());
  for (const Json& p : j["pmi"]) text += "pmi: " + p.get<std::string>() + "\n";
  if (j.contains("edge_list")) {
    rows = {{"edge", "kind", "length mm", "dihedral deg", "curve", "faces"}};
    for (const Json& e : j["edge_list"]) {
      std::string faces;
      for (const Json& f : e["faces"]) faces += (faces.empty() ? "" : " ") + f.get<std::string>();
      rows.push_back({e["id"], e["kind"], fixed_number(e["length"], 3), fixed_number(e["dihedral"], 2), e["curve"], faces});
    }
    text += text_table(rows);
  }
  return text;
}

/// A mesh file as the cad command shows it: its triangles; faces and edges have no names in such a file.
Brep brep_of_mesh(Mesh mesh, const std::string& units) {
  Brep b;
  b.units = units;
  b.box = mesh.box();
  std::map<std::pair<int, int>, int> sides;
  for (const auto& t : mesh.triangles) {
    const Vec3 &p = mesh.vertices[static_cast<std::size_t>(t[0])], &q = mesh.vertices[static_cast<std::size_t>(t[1])],
               &r = mesh.vertices[static_cast<std::size_t>(t[2])];
    b.area_mm2 += 0.5 * (q - p).cross(r - p).norm();
    b.volume_mm3 += p.dot(q.cross(r)) / 6;
    for (int k = 0; k < 3; ++k) ++sides[std::minmax(t[static_cast<std::size_t>(k)], t[static_cast<std::size_t>((k + 1) % 3)])];
  }
  for (const auto& [side, uses] : sides) b.open_edges_count += uses == 1;
  b.shells_count = 1;
  b.solids_count = b.open_edges_count == 0 ? 1 : 0;
  if (b.open_edges_count != 0) b.volume_mm3 = 0;
  b.mesh = std::move(mesh);
  return b;
}

}  // namespace

int cad_command(const CadArguments& a, Console& console) {
  const auto bytes = read_file(a.file, a.file);
  if (!bytes) return console.complain(bytes.error()), 2;
  const std::string name = std::filesystem::path(a.file).filename().string();
  StepTiming timing;
  Done<Brep> done;
  const std::string end = lower_extension(a.file);
  const bool is_step = end == ".step" || end == ".stp" || end == ".p21" || bytes->substr(0, 4096).find("ISO-10303-21") != std::string::npos;
  if (is_step) {
    StepOptions options;
    options.chord_mm = a.chord_mm;
    if (a.angle_deg > 0) options.angle_rad = rad_from_deg(a.angle_deg);
    options.timing = &timing;
    auto read = read_step(*bytes, name, options);
    if (!read) return console.complain(read.error()), 2;
    done = std::move(*read);
  } else {
    const auto start = std::chrono::steady_clock::now();
    std::optional<double> mm = mesh_unit_mm(*bytes, name);
    const std::map<std::string, double> known{{"mm", 1}, {"cm", 10}, {"m", 1000}, {"inch", 25.4}};
    if (!mm) {
      if (!known.contains(a.units)) return console.complain(name + ": the format carries no unit; say --units mm, cm, m or inch"), 2;
      mm = known.at(a.units);
    }
    auto read = read_mesh(*bytes, name, *mm);
    if (!read) return console.complain(read.error()), 2;
    done.artefact = brep_of_mesh(std::move(read->mesh), a.units.empty() ? fmt::format("{:g} mm", *mm) : a.units);
    timing.parse_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }
  for (const Note& n : done.notes) console.say((n.where.empty() ? "" : n.where + ": ") + n.text);
  if (!a.mesh_out.empty()) {
    const std::string to = lower_extension(a.mesh_out);
    if (to != ".ply" && to != ".stl") return console.complain("--mesh " + a.mesh_out + ": the name has to end in .ply or .stl"), 2;
    const auto written = write_file(a.mesh_out, to == ".ply" ? write_mesh_ply(done.artefact.mesh) : write_mesh_stl(done.artefact.mesh));
    if (!written) return console.complain(written.error()), 2;
  }
  const Json json = cad_json(done.artefact, timing, a.wants_edges);
  console.answer(json, cad_text(json, name));
  return 0;
}

}  // namespace asbuilt
