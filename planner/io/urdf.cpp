// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/urdf.hpp"

#include <tinyxml2.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "planner/io/text_scan.hpp"

namespace asbuilt {

namespace {

using tinyxml2::XMLElement;
using Transform = Pose<frame::Base, frame::Base>;

struct Fault {
  std::string code;
  int line;
  std::string message;
};

struct Joint {
  std::string name, type, parent, child;
  Transform T_parent_joint;
  Vec3 axis = Vec3::UnitX();
  double lower_rad = 0, upper_rad = 0, speed_rad_s = 0;
  int line = 0;
  bool moves() const { return type != "fixed"; }
};

std::string text_of(const XMLElement& e, const char* attribute) {
  const char* t = e.Attribute(attribute);
  return t ? t : "";
}

Vec3 three(const XMLElement& e, const char* attribute, const Vec3& absent) {
  const char* text = e.Attribute(attribute);
  if (!text) return absent;
  std::string_view line = text;
  Vec3 v;
  for (int k = 0; k < 3; ++k)
    if (!text_scan::parse_number(text_scan::take_word(line), v[k]) || !std::isfinite(v[k]))
      throw Fault{"input.urdf_value", e.GetLineNum(),
                  std::string("found ") + attribute + "=\"" + std::string(text).substr(0, 60) + "\", allowed three numbers"};
  return v;
}

double one(const XMLElement& e, const char* attribute, double absent) {
  const char* text = e.Attribute(attribute);
  if (!text) return absent;
  std::string_view line = text;
  double v = 0;
  if (!text_scan::parse_number(text_scan::take_word(line), v) || !std::isfinite(v))
    throw Fault{"input.urdf_value", e.GetLineNum(),
                std::string("found ") + attribute + "=\"" + std::string(text).substr(0, 60) + "\", allowed a number"};
  return v;
}

Transform origin_of(const XMLElement& e) {
  const XMLElement* o = e.FirstChildElement("origin");
  if (!o) return {};
  const Vec3 rpy = three(*o, "rpy", Vec3::Zero());
  return {quat_from_zyx(rpy.z(), rpy.y(), rpy.x()).normalized(), 1000.0 * three(*o, "xyz", Vec3::Zero())};
}

Mesh box_mesh(const Vec3& size_mm) {
  Mesh m;
  for (int i = 0; i < 8; ++i) m.vertices.push_back(0.5 * size_mm.cwiseProduct(Vec3(i & 1 ? 1 : -1, i & 2 ? 1 : -1, i & 4 ? 1 : -1)));
  m.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                 {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return m;
}

/// A turning body about z from its profile (radius, height), widened so that it lies outside the exact one.
Mesh turned_mesh(const std::vector<Vec2>& profile_mm) {
  constexpr int kSides = 32;
  Mesh m;
  const double widen = 1.0 / std::cos(kPi / kSides);
  for (const Vec2& p : profile_mm)
    for (int k = 0; k < kSides; ++k)
      m.vertices.emplace_back(p.x() * widen * std::cos(2 * kPi * k / kSides), p.x() * widen * std::sin(2 * kPi * k / kSides), p.y());
  const int rings = int(profile_mm.size());
  for (int r = 0; r + 1 < rings; ++r)
    for (int k = 0; k < kSides; ++k) {
      const int a = r * kSides + k, b = r * kSides + (k + 1) % kSides;
      m.triangles.push_back({a, b, a + kSides}), m.triangles.push_back({b, b + kSides, a + kSides});
    }
  for (const int r : {0, rings - 1}) {
    const int center = int(m.vertices.size());
    m.vertices.emplace_back(0, 0, profile_mm[std::size_t(r)].y());
    for (int k = 0; k < kSides; ++k) {
      const int a = r * kSides + k, b = r * kSides + (k + 1) % kSides;
      m.triangles.push_back(r == 0 ? std::array<int, 3>{center, b, a} : std::array<int, 3>{center, a, b});
    }
  }
  return m;
}

UrdfShape shape_of(const XMLElement& e, const std::string& link) {
  UrdfShape s;
  s.link = link;
  s.line = e.GetLineNum();
  s.T_base_shape = origin_of(e);
  const XMLElement* g = e.FirstChildElement("geometry");
  const XMLElement* kind = g ? g->FirstChildElement() : nullptr;
  const std::string name = kind ? kind->Name() : "";
  if (name == "mesh") {
    s.file = text_of(*kind, "filename");
    s.scale = three(*kind, "scale", Vec3::Ones());
    if (s.file.empty()) throw Fault{"input.urdf_value", kind->GetLineNum(), "found a mesh without filename"};
    if (!(s.scale.array().abs() > 0).all()) throw Fault{"input.urdf_value", kind->GetLineNum(), "found a mesh scale of 0"};
  } else if (name == "box") {
    s.mesh_shape = box_mesh(1000.0 * three(*kind, "size", Vec3::Zero()));
  } else if (name == "cylinder") {
    const double r = 1000 * one(*kind, "radius", 0), h = 500 * one(*kind, "length", 0);
    s.mesh_shape = turned_mesh({{r, -h}, {r, h}});
  } else if (name == "sphere") {
    const double r = 1000 * one(*kind, "radius", 0);
    std::vector<Vec2> profile;
    for (int k = 1; k < 16; ++k)
      profile.emplace_back(r * std::sin(kPi * k / 16) / std::cos(kPi / 32), -r * std::cos(kPi * k / 16) / std::cos(kPi / 32));
    s.mesh_shape = turned_mesh(profile);
  } else {
    throw Fault{"input.urdf_value", e.GetLineNum(), "found the geometry '" + name.substr(0, 40) + "', allowed mesh, box, cylinder, sphere"};
  }
  return s;
}

struct Tree {
  std::vector<std::string> links;  // in file order
  std::map<std::string, const XMLElement*> link_element;
  std::map<std::string, Joint> joint_of_child;

  /// The joints from the root down to the link.
  std::vector<const Joint*> path(const std::string& link) const {
    std::vector<const Joint*> joints;
    std::set<std::string> seen;
    std::string at = link;
    while (true) {
      if (!seen.insert(at).second) throw Fault{"input.urdf_link", 0, "found a loop of joints at link '" + at + "', allowed a tree"};
      const auto it = joint_of_child.find(at);
      if (it == joint_of_child.end()) break;
      joints.push_back(&it->second);
      at = it->second.parent;
    }
    std::reverse(joints.begin(), joints.end());
    return joints;
  }
};

Tree tree_of(const XMLElement& robot) {
  Tree tree;
  for (const XMLElement* l = robot.FirstChildElement("link"); l; l = l->NextSiblingElement("link")) {
    const std::string name = text_of(*l, "name");
    if (!tree.link_element.emplace(name, l).second)
      throw Fault{"input.urdf_link", l->GetLineNum(), "found the link '" + name + "' twice, allowed once"};
    tree.links.push_back(name);
  }
  for (const XMLElement* e = robot.FirstChildElement("joint"); e; e = e->NextSiblingElement("joint")) {
    Joint j;
    j.line = e->GetLineNum();
    j.name = text_of(*e, "name"), j.type = text_of(*e, "type");
    if (const XMLElement* p = e->FirstChildElement("parent")) j.parent = text_of(*p, "link");
    if (const XMLElement* c = e->FirstChildElement("child")) j.child = text_of(*c, "link");
    for (const std::string& l : {j.parent, j.child})
      if (!tree.link_element.count(l))
        throw Fault{"input.urdf_link", j.line, "found the joint '" + j.name + "' at the link '" + l + "', which is not in the file"};
    j.T_parent_joint = origin_of(*e);
    if (const XMLElement* a = e->FirstChildElement("axis")) j.axis = three(*a, "xyz", Vec3::UnitX());
    if (j.moves() && !(j.axis.norm() > 1e-9))
      throw Fault{"input.urdf_value", j.line, "found the joint '" + j.name + "' with an axis of length 0"};
    j.axis.normalize();
    if (const XMLElement* l = e->FirstChildElement("limit"))
      j.lower_rad = one(*l, "lower", 0), j.upper_rad = one(*l, "upper", 0), j.speed_rad_s = one(*l, "velocity", 0);
    if (j.type == "continuous") j.lower_rad = j.upper_rad = 0;
    if (!tree.joint_of_child.emplace(j.child, j).second)
      throw Fault{"input.urdf_link", j.line, "found two joints that carry the link '" + j.child + "', allowed one"};
  }
  return tree;
}

Done<UrdfRobot> robot_of(const XMLElement& robot, const std::string& name, const std::string& base, const std::string& tip) {
  const Tree tree = tree_of(robot);
  for (const std::string& l : {base, tip})
    if (!tree.link_element.count(l)) {
      std::string all;
      for (std::size_t i = 0; i < tree.links.size() && i < 40; ++i) all += (all.empty() ? "" : ", ") + tree.links[i];
      throw Fault{"input.urdf_link", robot.GetLineNum(), "found no link '" + l + "', allowed one of " + all};
    }
  const auto to_base = tree.path(base), to_tip = tree.path(tip);
  if ((to_base.empty() ? base : to_base.front()->parent) != (to_tip.empty() ? tip : to_tip.front()->parent))
    throw Fault{"input.urdf_link", robot.GetLineNum(), "found no chain of joints between '" + base + "' and '" + tip + "'"};
  std::size_t common = 0;
  while (common < to_base.size() && common < to_tip.size() && to_base[common] == to_tip[common]) ++common;
  Transform T_base_at;  // from base up to the link where both paths part
  for (std::size_t i = to_base.size(); i-- > common;) {
    if (to_base[i]->moves())
      throw Fault{"input.urdf_joints", to_base[i]->line,
                  "found the moving joint '" + to_base[i]->name + "' on the way from '" + base + "' up, allowed fixed ones"};
    T_base_at = T_base_at * to_base[i]->T_parent_joint.inverse();
  }
  Done<UrdfRobot> done;
  UrdfRobot& out = done.artefact;
  out.kinematics.urdf = name, out.kinematics.base_link = base, out.kinematics.tip_link = tip;
  Transform T_last_at = T_base_at;
  std::map<const Joint*, int> index;
  for (std::size_t i = common; i < to_tip.size(); ++i) {
    const Joint& j = *to_tip[i];
    T_last_at = T_last_at * j.T_parent_joint;
    if (!j.moves()) continue;
    if (j.type != "revolute" && j.type != "continuous")
      throw Fault{
          "input.urdf_joints", j.line,
          "found the joint '" + j.name + "' of type '" + j.type.substr(0, 40) + "' in the chain, allowed revolute, continuous, fixed"};
    out.kinematics.joints.push_back({.name = j.name, .T_parent_joint = T_last_at, .axis = j.axis});
    out.limits_rad.push_back({j.lower_rad, j.upper_rad});
    out.speed_rad_s.push_back(j.speed_rad_s);
    index[&j] = int(out.kinematics.joints.size());
    T_last_at = {};
  }
  out.kinematics.T_last_tip = T_last_at;
  if (out.kinematics.joints.size() != 6)
    throw Fault{
        "input.urdf_joints", robot.GetLineNum(),
        "found " + std::to_string(out.kinematics.joints.size()) + " turning joints between '" + base + "' and '" + tip + "', allowed 6"};

  Transform T_base_root = T_base_at;
  for (std::size_t i = common; i-- > 0;) T_base_root = T_base_root * to_tip[i]->T_parent_joint.inverse();
  for (const std::string& link : tree.links) {
    Transform T_base_link = T_base_root;
    int joint = 0;
    std::string side;
    const auto joints = tree.path(link);
    if ((joints.empty() ? link : joints.front()->parent) != (to_tip.empty() ? tip : to_tip.front()->parent)) continue;  // another tree
    for (const Joint* j : joints) {
      T_base_link = T_base_link * j->T_parent_joint;
      if (const auto it = index.find(j); it != index.end()) joint = it->second;
      else if (j->moves() &&
               std::find(to_base.begin(), to_base.begin() + std::ptrdiff_t(common), j) == to_base.begin() + std::ptrdiff_t(common))
        side = j->name;
    }
    const XMLElement& element = *tree.link_element.at(link);
    const char* kind = element.FirstChildElement("collision") ? "collision" : "visual";
    bool has_shape = false;
    for (const XMLElement* e = element.FirstChildElement(kind); e; e = e->NextSiblingElement(kind)) {
      if (!e->FirstChildElement("geometry")) continue;
      UrdfShape s = shape_of(*e, link);
      s.T_base_shape = T_base_link * s.T_base_shape;
      s.joint = joint;
      has_shape = true;
      out.shapes.push_back(std::move(s));
    }
    if (has_shape && !side.empty())
      done.notes.push_back(
          {.level = Note::Level::warning,
           .code = "input.urdf_side_joint",
           .text = "the shape of link '" + link + "' hangs on the joint '" + side + "' outside the chain and is kept where it is at 0",
           .where = name});
  }
  return done;
}

}  // namespace

Result<Done<UrdfRobot>> read_urdf(std::string_view bytes, const std::string& name, const std::string& base, const std::string& tip) {
  const auto refused = [&](const Fault& f) {
    return refuse({.code = f.code, .where = name + (f.line ? ":" + std::to_string(f.line) : ""), .message = f.message, .stage = "input"});
  };
  tinyxml2::XMLDocument document;
  if (document.Parse(bytes.data(), bytes.size()) != tinyxml2::XML_SUCCESS)
    return refused({"input.urdf_syntax", document.ErrorLineNum(), std::string("found text that is no XML (") + document.ErrorName() + ")"});
  const XMLElement* robot = document.FirstChildElement("robot");
  if (!robot) return refused({"input.urdf_syntax", 1, "found no element 'robot', allowed a URDF"});
  try {
    return robot_of(*robot, name, base, tip);
  } catch (const Fault& f) {
    return refused(f);
  }
}

}  // namespace asbuilt
