// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/three_mf.hpp"

#include <tinyxml2.h>

#include <map>

#include "planner/io/text_scan.hpp"
#include "planner/io/welder.hpp"
#include "planner/io/zip_file.hpp"

namespace asbuilt {

namespace {

using tinyxml2::XMLElement;

constexpr std::size_t kModelLimit = std::size_t(1) << 30;
constexpr std::size_t kTrianglesLimit = 50'000'000;

struct Fault {
  int line;
  std::string message;
};

double number(const XMLElement& e, const char* attribute) {
  const char* text = e.Attribute(attribute);
  double v = 0;
  if (!text || !text_scan::parse_number(text, v))
    throw Fault{e.GetLineNum(),
                std::string("found no number '") + attribute + "' in the element '" + std::string(e.Name()).substr(0, 40) + "'"};
  return v;
}

/// Twelve numbers, row by row, points being rows: p' = p * M.
Eigen::Affine3d transform_of(const XMLElement& e) {
  Eigen::Affine3d T = Eigen::Affine3d::Identity();
  const char* text = e.Attribute("transform");
  if (!text) return T;
  std::string_view line = text;
  double m[12];
  for (double& v : m)
    if (!text_scan::parse_number(text_scan::take_word(line), v))
      throw Fault{e.GetLineNum(), "found a transform of less than twelve numbers"};
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) T.linear()(c, r) = m[3 * r + c];
  T.translation() = Vec3(m[9], m[10], m[11]);
  return T;
}

struct Model {
  std::map<std::string, const XMLElement*> objects;
  MeshFile out;
  Welder welder;
  double mm_per_unit = 1;

  void add(const std::string& id, const Eigen::Affine3d& T, int line, int depth) {
    const auto it = objects.find(id);
    if (it == objects.end()) throw Fault{line, "found the object '" + id.substr(0, 40) + "', which is not in the file"};
    if (depth > 32) throw Fault{line, "found components nested deeper than 32"};
    if (const XMLElement* mesh = it->second->FirstChildElement("mesh")) add_mesh(*mesh, T);
    if (const XMLElement* list = it->second->FirstChildElement("components"))
      for (const XMLElement* c = list->FirstChildElement("component"); c; c = c->NextSiblingElement("component")) {
        if (c->Attribute("p:path"))
          throw Fault{c->GetLineNum(),
                      "found a component in another file of the archive, allowed objects of the root model; export it as one model"};
        const char* child = c->Attribute("objectid");
        add(child ? child : "", T * transform_of(*c), c->GetLineNum(), depth + 1);
      }
  }
  void add_mesh(const XMLElement& mesh, const Eigen::Affine3d& T) {
    std::vector<Vec3> vertices;
    const XMLElement* list = mesh.FirstChildElement("vertices");
    for (const XMLElement* v = list ? list->FirstChildElement("vertex") : nullptr; v; v = v->NextSiblingElement("vertex"))
      vertices.push_back(mm_per_unit * (T * Vec3(number(*v, "x"), number(*v, "y"), number(*v, "z"))));
    const bool is_mirrored = T.linear().determinant() < 0;
    list = mesh.FirstChildElement("triangles");
    for (const XMLElement* t = list ? list->FirstChildElement("triangle") : nullptr; t; t = t->NextSiblingElement("triangle")) {
      std::array<Vec3, 3> corner;
      const char* names[] = {"v1", "v2", "v3"};
      for (std::size_t k = 0; k < 3; ++k) {
        const double i = number(*t, names[k]);
        if (!(i >= 0 && i < double(vertices.size())) || i != std::floor(i))
          throw Fault{t->GetLineNum(), "found a triangle with a corner that is not in the file"};
        corner[is_mirrored ? 2 - k : k] = vertices[std::size_t(i)];
      }
      welder.add(corner, out);
      if (out.mesh.triangles.size() > kTrianglesLimit) throw Fault{t->GetLineNum(), "found more than 50 million triangles"};
    }
  }
};

}  // namespace

std::optional<double> three_mf_unit_mm(std::string_view bytes) {
  const std::optional<std::string> model = read_zip_entry(bytes, ".model", std::size_t(1) << 16);
  if (!model) return std::nullopt;
  const std::size_t tag = model->find("<model");
  if (tag == std::string::npos) return std::nullopt;
  const std::string head = model->substr(tag, model->find('>', tag) - tag);
  const std::size_t unit = head.find(" unit=");
  if (unit == std::string::npos || head.size() < unit + 8) return 1.0;
  const std::string word = head.substr(unit + 7, head.find(head[unit + 6], unit + 7) - unit - 7);
  static constexpr std::pair<std::string_view, double> units[] = {{"micron", 0.001}, {"millimeter", 1}, {"centimeter", 10},
                                                                  {"inch", 25.4},    {"foot", 304.8},   {"meter", 1000}};
  for (const auto& [name_of_unit, mm] : units)
    if (word == name_of_unit) return mm;
  return std::nullopt;
}

Result<MeshFile> read_three_mf(std::string_view bytes, const std::string& name, double mm_per_unit) {
  const auto refused = [&](const char* code, int line, const std::string& message) {
    return refuse(
        {.code = code, .where = name + (line ? ": 3D model, line " + std::to_string(line) : ""), .message = message, .stage = "input"});
  };
  const std::optional<std::string> text = read_zip_entry(bytes, ".model", kModelLimit);
  if (!text) return refused("input.mesh_broken", 0, "found no 3MF archive with a 3D model; copy or export the file again");
  tinyxml2::XMLDocument document;
  if (document.Parse(text->data(), text->size()) != tinyxml2::XML_SUCCESS)
    return refused("input.mesh_broken", document.ErrorLineNum(), std::string("found text that is no XML (") + document.ErrorName() + ")");
  const XMLElement* root = document.FirstChildElement("model");
  const XMLElement* resources = root ? root->FirstChildElement("resources") : nullptr;
  const XMLElement* build = root ? root->FirstChildElement("build") : nullptr;
  if (!resources || !build) return refused("input.mesh_broken", 1, "found no model with resources and a build");
  Model model;
  model.mm_per_unit = mm_per_unit;
  try {
    for (const XMLElement* o = resources->FirstChildElement("object"); o; o = o->NextSiblingElement("object"))
      if (const char* id = o->Attribute("id")) model.objects[id] = o;
    for (const XMLElement* item = build->FirstChildElement("item"); item; item = item->NextSiblingElement("item")) {
      const char* id = item->Attribute("objectid");
      model.add(id ? id : "", transform_of(*item), item->GetLineNum(), 0);
    }
  } catch (const Fault& f) {
    return refused("input.mesh_broken", f.line, f.message);
  }
  return std::move(model.out);
}

}  // namespace asbuilt
