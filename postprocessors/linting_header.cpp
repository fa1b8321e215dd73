// SPDX-License-Identifier: GPL-3.0-or-later
// What the header of a program states of tool, frame and controller, held against the cell and against the program itself. A header that
// states nothing (a program of another origin) breaks no rule: only lines in the form of a statement are taken for one.
#include <cmath>
#include <charconv>

#include "postprocessors/linting.hpp"

namespace asbuilt::linting {
namespace {

/// Numbers of a text, in order; a digit inside a word is none.
std::vector<double> numbers_of(std::string_view text) {
  std::vector<double> out;
  for (std::size_t i = 0; i < text.size();) {
    double v = 0;
    const bool is_start = i == 0 || text[i - 1] == ' ' || text[i - 1] == ',';
    const auto r = is_start ? std::from_chars(text.data() + i, text.data() + text.size(), v) : std::from_chars_result{text.data() + i, std::errc::invalid_argument};
    if (r.ec == std::errc()) out.push_back(v), i = static_cast<std::size_t>(r.ptr - text.data());
    else ++i;
  }
  return out;
}

/// "x y z mm, ZYX a b c deg"; nothing where it is another text.
template <class A, class B>
std::optional<Pose<A, B>> stated_pose(std::string_view text) {
  const std::size_t zyx = text.find(" mm, ZYX ");
  if (zyx == std::string_view::npos || !text.ends_with(" deg")) return std::nullopt;
  const auto p = numbers_of(text.substr(0, zyx)), a = numbers_of(text.substr(zyx + 9));
  if (p.size() != 3 || a.size() != 3) return std::nullopt;
  return Pose<A, B>(reading::rotation_zyx(a[0], a[1], a[2]), Vec3(p[0], p[1], p[2]));
}
/// As printed: half of 0.001 mm a coordinate, half of 0.0001 degree an angle.
template <class A, class B>
bool is_as_stated(const Pose<A, B>& stated, const Pose<A, B>& T) {
  return (stated.p_mm - T.p_mm).cwiseAbs().maxCoeff() <= 0.00051 && quat_log(stated.q.conjugate() * T.q).norm() <= rad_from_deg(8.7e-5);
}
/// The same frame, whose axes may be named in another order.
double turn_but_right_angles(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  double least = 1e9;
  const Mat3 R = (a.conjugate() * b).toRotationMatrix(), nearest = R.array().round();
  if (std::abs(nearest.determinant() - 1) < 1e-9 && nearest.cwiseAbs().sum() == 3) least = quat_log(Eigen::Quaterniond(Mat3(nearest.transpose() * R)).normalized()).norm();
  return std::min(least, quat_log(a.conjugate() * b).norm());
}

std::string option_of(const PostContext& context, const std::string& key) {
  const auto it = context.cell.controller.options.find(key);
  return it == context.cell.controller.options.end() ? "" : it->second;
}

struct Header {
  Findings& f;
  const Program& program;
  const PostContext& context;
  Language language;
  std::set<int> tools;
  bool has_tool = false, has_frame = false, has_controller = false, has_run = false;
  std::string where() const { return program.name + ": header"; }

  void tool(std::string_view line) {  // tool N ID: pose
    has_tool = true;
    const std::size_t colon = line.find(": ");
    const auto n = numbers_of(line.substr(0, colon));
    const auto T = colon == std::string_view::npos ? std::nullopt : stated_pose<frame::Flange, frame::Tool>(line.substr(colon + 2));
    if (n.empty() || !T) return f.add("G-14", where(), "no statement of a tool: " + std::string(line));
    for (const ToolSpec& t : context.cell.tools) {
      if (t.number != n[0]) continue;
      tools.insert(t.number);
      if (line.substr(0, colon) != "tool " + std::to_string(t.number) + " " + t.id) f.add("G-14", where(), "tool " + std::to_string(t.number) + " has another name in the cell, " + t.id);
      if (!is_as_stated(*T, t.T_flange_tool)) f.add("G-14", where(), "tool " + std::to_string(t.number) + " is another one in the cell: the program was made with another calibration");
      return;
    }
    f.add("G-14", where(), "the tool stated is not in the cell: " + std::string(line));
  }
  void frame(std::string_view line) {  // frame NAME: pose
    has_frame = true;
    const std::size_t colon = line.find(": ");
    const auto T = colon == std::string_view::npos ? std::nullopt : stated_pose<frame::Base, frame::Work>(line.substr(colon + 2));
    if (!T) return f.add("G-15", where(), "no statement of a frame: " + std::string(line));
    for (const Instruction& i : program.instructions)
      if (const auto* s = std::get_if<SetFrame>(&i)) {
        const bool is_base = s->T_base_work.p_mm.norm() == 0 && s->T_base_work.q.vec().norm() == 0;  // a dialect may write its points in base
        if (!is_base && ((s->T_base_work.p_mm - T->p_mm).cwiseAbs().maxCoeff() > 0.00051 || turn_but_right_angles(T->q, s->T_base_work.q) > rad_from_deg(1.8e-4)))
          f.add("G-15", where(), "the program's frame is not the one stated: " + std::string(line));
      }
  }
  void controller(std::string_view line) {  // controller LANGUAGE: what the text depends on
    has_controller = true;
    const std::string name(name_of(language)), head = "controller " + name + ": ";
    if (!line.starts_with(head)) return f.add("G-16", where(), "stated for another language: " + std::string(line));
    const auto& c = context.cell.controller;
    const auto is_part = [&](const std::string& part) {
      const std::size_t at = line.find(part, head.size());
      return at != std::string_view::npos && (at == head.size() || line[at - 1] == ' ') && (at + part.size() == line.size() || line[at + part.size()] == ',');
    };
    const auto need = [&](const std::string& part) {
      if (!is_part(part)) f.add("G-16", where(), "the cell says \"" + part + "\", the program \"" + std::string(line) + "\"");
    };
    if (language == Language::krl) {
      need(option_of(context, "krl.version").empty() ? "KRC4" : option_of(context, "krl.version"));
      for (const char* key : {"serial_number", "kernel"})
        if (const std::string v = option_of(context, std::string("krl.") + key); !v.empty()) need(std::string(key) + " " + v);
    } else if (language == Language::inform) {
      if (c.speed_unit) need("V in " + std::string(name_of(*c.speed_unit)));
      const std::size_t at = line.find("pulses per degree ");
      const auto stated = at == std::string_view::npos ? std::vector<double>() : numbers_of(line.substr(at));
      for (std::size_t i = 0; c.pulses_per_degree && i < 6; ++i)
        if (stated.size() != 6 || std::abs(stated[i] - (*c.pulses_per_degree)[i]) > 1e-5)
          return f.add("G-16", where(), "other pulses per degree in the cell: the program was made for another robot");
    } else if (language == Language::beckhoff) {
      if (c.orientation) need("A B C by " + std::string(name_of(*c.orientation)));
      if (c.kinematic_id) need("kinematic " + std::to_string(*c.kinematic_id));
    } else if (language == Language::nci) {
      if (const std::string v = option_of(context, "nci.orientation"); !v.empty()) need("Q1 Q2 Q3 by " + v);
      if (const std::string v = option_of(context, "nci.kinematics"); !v.empty()) need("kinematics by M " + v);
    }
  }
  void run(std::string_view line) {
    if (has_run) f.add("G-17", where(), "run and not run are stated both, or twice");
    has_run = true;
    const std::string receipt = option_of(context, std::string(name_of(language)) + ".receipt");
    if (line.starts_with("not run")) return;
    if (receipt.empty() || line != "run on a controller: " + receipt) f.add("G-17", where(), "a run on a controller is stated that the cell holds no receipt of");
  }
};

}  // namespace

void header_rules(Findings& findings, const Program& program, const PostContext& context, Language language) {
  Header h{findings, program, context, language, {}};
  for (const std::string& text : program.header) {
    const std::string_view line(text);
    const bool has_pose = line.find(": ") < line.find(" mm, ZYX ") && line.find(" mm, ZYX ") != std::string_view::npos;
    bool has_language = false;
    for (const Language l : kLanguages) has_language |= line.starts_with("controller " + std::string(name_of(l)) + ": ");
    if (line.starts_with("tool ") && has_pose) h.tool(line);
    else if (line.starts_with("frame ") && has_pose) h.frame(line);
    else if (has_language) h.controller(line);
    else if (line == "not run on a controller" || line.starts_with("run on a controller")) h.run(line);
  }
  if (h.has_tool)
    for (const Instruction& i : program.instructions)
      if (const auto* s = std::get_if<SetTool>(&i); s && !h.tools.count(s->number)) findings.add("G-14", h.where(), "tool " + std::to_string(s->number) + " is used and not stated");
  if (h.has_controller && !h.has_run) findings.add("G-17", h.where(), "whether it was run on a controller is not stated");
  if (h.has_run && !h.has_controller) findings.add("G-16", h.where(), "the controller that it is for is not stated");
  if (h.has_tool != h.has_frame) findings.add(h.has_tool ? "G-15" : "G-14", h.where(), "tool and frame are stated together");
}

}  // namespace asbuilt::linting
