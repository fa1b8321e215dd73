// SPDX-License-Identifier: GPL-3.0-or-later
#include "postprocessors/writing.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "planner/base/hash.hpp"
#include "planner/base/number.hpp"

namespace asbuilt::writing {

std::array<double, 3> zyx_angles(const Mat3& R) {
  const double cos_b = std::hypot(R(0, 0), R(1, 0));
  const double b = std::atan2(-R(2, 0), cos_b);
  if (cos_b < 1e-9) {  // only a - c (or a + c) is defined
    return {std::atan2(-R(0, 1), R(1, 1)), b, 0.0};
  }
  return {std::atan2(R(1, 0), R(0, 0)), b, std::atan2(R(2, 1), R(2, 2))};
}

std::array<double, 3> round_zyx(std::array<double, 3> abc_deg, int decimals) {
  const double a = rounded(abc_deg[0], decimals);
  const double c = abc_deg[2] - (abc_deg[0] - a) * std::sin(rad_from_deg(abc_deg[1]));
  return {a, rounded(abc_deg[1], decimals), rounded(c, decimals)};
}

Printed print_pose(const Mat3& R, const Vec3& p_mm, int mm_decimals, int deg_decimals) {
  Printed out;
  const auto abc = zyx_angles(R);
  out.abc_deg = round_zyx({deg_from_rad(abc[0]), deg_from_rad(abc[1]), deg_from_rad(abc[2])}, deg_decimals);
  for (int i = 0; i < 3; ++i) {
    out.xyz_mm[i] = rounded(p_mm[i], mm_decimals);
    if (out.abc_deg[i] <= -180.0) out.abc_deg[i] = 180.0;
  }
  return out;
}

Pose<frame::Base, frame::Work> frame_of(const Printed& p) {
  return {quat_from_zyx(rad_from_deg(p.abc_deg[0]), rad_from_deg(p.abc_deg[1]), rad_from_deg(p.abc_deg[2])),
          Vec3(p.xyz_mm[0], p.xyz_mm[1], p.xyz_mm[2])};
}

Refusal fault(std::string code, std::string where, std::string message, double measured, double limit, std::string unit) {
  return {.code = std::move(code), .where = std::move(where), .message = std::move(message), .measured = measured, .limit = limit,
          .unit = std::move(unit), .stage = "post"};
}

const ToolSpec* find_tool(const PostContext& context, int number) {
  for (const ToolSpec& t : context.cell.tools)
    if (t.number == number) return &t;
  return nullptr;
}

std::optional<std::string> option(const PostContext& context, const std::string& key) {
  const auto it = context.cell.controller.options.find(key);
  if (it == context.cell.controller.options.end()) return std::nullopt;
  return it->second;
}

Result<int> option_int(const PostContext& context, const std::string& key, int otherwise, int lo, int hi) {
  const auto text = option(context, key);
  if (!text) return otherwise;
  int value = 0;
  const auto r = std::from_chars(text->data(), text->data() + text->size(), value);
  if (r.ec != std::errc() || r.ptr != text->data() + text->size() || value < lo || value > hi)
    return refuse(fault("post.option", "cell.yaml: controller." + key,
                        "\"" + *text + "\" is no whole number from " + std::to_string(lo) + " to " + std::to_string(hi), value, hi));
  return value;
}

void check_options(const PostContext& context, std::string_view block, const std::vector<std::string_view>& known, Refusals& faults) {
  const std::string prefix = std::string(block) + ".";
  for (const auto& [key, value] : context.cell.controller.options) {
    if (!key.starts_with(prefix)) continue;
    const std::string_view name = std::string_view(key).substr(prefix.size());
    const bool is_known = std::any_of(known.begin(), known.end(), [&](std::string_view k) { return k.ends_with('.') ? name.starts_with(k) : name == k; });
    if (is_known) continue;
    std::string list;
    for (std::string_view k : known) list += (list.empty() ? "" : ", ") + std::string(k) + (k.ends_with('.') ? "N" : "");
    faults.push_back(fault("post.option", "cell.yaml: controller." + key, "is not known; there are " + list));
  }
}

namespace {

bool is_ascii_line(std::string_view s) {
  return std::all_of(s.begin(), s.end(), [](char c) { return c >= 0x20 && c <= 0x7e; });
}
bool is_finite(const Pose<frame::Base, frame::Tool>& T) {
  return T.q.coeffs().allFinite() && T.p_mm.allFinite() && std::abs(T.q.norm() - 1) < 1e-6 && T.p_mm.cwiseAbs().maxCoeff() < 1e6;
}

double arc_length(const Vec3& a, const Vec3& via, const Vec3& b) {
  const Vec3 u = via - a, v = b - via;
  const double turn = 2 * std::atan2(u.cross(v).norm(), u.dot(v)), chord = (b - a).norm();  // the arc's own angle is twice that between the chords
  return turn < 1e-9 ? chord : chord / (2 * std::sin(turn / 2)) * turn;
}

struct Checker {
  const Program& program;
  const PostContext& context;
  const Limits& limits;
  Refusals out;
  const ToolSpec* tool = nullptr;
  bool has_frame = false, has_joint_move = false, is_spinning = false;
  std::optional<Vec3> p_now;  // in base; none after a joint move
  bool was_blended = false, is_in_spline = false;
  std::array<bool, 5> is_on{};
  std::size_t at = 0;

  std::string where() const { return program.name + ": instruction " + std::to_string(at + 1); }
  void bad(std::string code, std::string message, double measured = 0, double limit = 0, std::string unit = "") {
    out.push_back(fault(std::move(code), where(), std::move(message), measured, limit, std::move(unit)));
  }
  void ready_to_move(bool is_path) {
    if (!tool) bad("post.order", "a motion comes before the tool is set; set it first");
    if (is_path && !has_frame) bad("post.order", "a path motion comes before the frame is set; set it first");
    if (is_path && !has_joint_move) bad("post.order", "the first motion must be a joint move; begin at home");
  }
  void speed(double v, double blend, bool is_exact) {
    if (!std::isfinite(v) || v < limits.speed_min_mm_s || v <= 0 || v > limits.speed_max_mm_s)
      bad("post.speed", "the speed " + (std::isfinite(v) ? shortest_number(v) : std::string("(not finite)")) + " mm/s is outside what " +
                            "the controller takes, " + shortest_number(limits.speed_min_mm_s) + " to " +
                            shortest_number(limits.speed_max_mm_s) + " mm/s; change the feed",
          std::isfinite(v) ? v : 0, limits.speed_max_mm_s, "mm/s");
    if (!is_exact && (!std::isfinite(blend) || blend < 0 || blend > 1000))
      bad("post.not_finite", "the rounding distance is no length from 0 to 1000 mm", 0, 1000, "mm");
    was_blended = !is_exact && blend > 0;
  }

  void operator()(const SetTool& s) {
    if (tool && tool->number != s.number) {
      if (is_spinning) bad("post.order", "the tool changes while the spindle turns; switch it off first");
      p_now.reset();  // another tool point: an arc cannot start here
    }
    tool = find_tool(context, s.number);
    if (!tool) {
      bad("post.tool", "tool number " + std::to_string(s.number) + " is not in the cell; add it to cell.yaml", s.number);
    } else if ((tool->T_flange_tool.p_mm - s.T_flange_tool.p_mm).norm() > 1e-6 ||
               quat_log(tool->T_flange_tool.q.conjugate() * s.T_flange_tool.q).norm() > 1e-8) {
      bad("post.tool",
          "the program's tool " + std::to_string(s.number) + " is not the cell's calibrated tool of that number; plan the item again",
          (tool->T_flange_tool.p_mm - s.T_flange_tool.p_mm).norm(), 1e-6, "mm");
    }
  }
  void operator()(const SetFrame& s) {
    has_frame = true;
    if (!s.T_base_work.q.coeffs().allFinite() || !s.T_base_work.p_mm.allFinite() || std::abs(s.T_base_work.q.norm() - 1) > 1e-6)
      bad("post.not_finite", "the work frame is not finite");
  }
  void operator()(const MoveJoint& m) {
    ready_to_move(false);
    has_joint_move = true;
    p_now.reset();
    was_blended = false;
    if (is_on[static_cast<std::size_t>(Equipment::arc)]) bad("post.order", "the arc is on in a joint move; switch it off first");
    for (int i = 0; i < 6; ++i) {
      const JointSpec& j = context.cell.robot.joints[i];
      if (!std::isfinite(m.q_rad[i])) {
        bad("post.not_finite", "joint " + std::to_string(i + 1) + " is not finite");
      } else if (j.max_rad > j.min_rad && (m.q_rad[i] < j.min_rad - 1e-6 || m.q_rad[i] > j.max_rad + 1e-6)) {
        bad("post.joint_limit", "joint " + std::to_string(i + 1) + " is outside its limits; plan the item again", deg_from_rad(m.q_rad[i]),
            deg_from_rad(m.q_rad[i] < j.min_rad ? j.min_rad : j.max_rad), "deg");
      }
    }
    if (!std::isfinite(m.speed_ratio) || m.speed_ratio < 0.01 - 1e-9 || m.speed_ratio > 1 + 1e-9)
      bad("post.joint_speed", "the joint speed is not between 0.01 and 1 of the limits", std::isfinite(m.speed_ratio) ? m.speed_ratio : 0, 1,
          "ratio");
  }
  void operator()(const MoveLinear& m) {
    ready_to_move(true);
    if (!is_finite(m.T_base_tool)) bad("post.not_finite", "the target is no finite pose");
    speed(m.speed_mm_s, m.blend_mm, m.is_exact);
    p_now = m.T_base_tool.p_mm;
  }
  void operator()(const MoveCircular& m) {
    ready_to_move(true);
    if (!is_finite(m.T_base_tool) || !is_finite(m.T_base_via)) bad("post.not_finite", "the target is no finite pose");
    speed(m.speed_mm_s, m.blend_mm, m.is_exact);
    if (!p_now) {
      bad("post.arc", "an arc must follow a straight move or another arc; move to its start first");
    } else {
      const Vec3 u = m.T_base_via.p_mm - *p_now, v = m.T_base_tool.p_mm - m.T_base_via.p_mm;
      const double sine = u.cross(v).norm() / std::max(1e-12, u.norm() * v.norm());
      if (u.norm() < 0.01 || v.norm() < 0.01 || sine < 1e-3 || u.dot(v) < -0.5 * u.norm() * v.norm())
        bad("post.arc", "start, middle and end do not define an arc below 180 degrees; write it as straight moves", sine, 1e-3, "sine");
      else if (2 * std::atan2(u.cross(v).norm(), u.dot(v)) > kPi * (1 + 1e-9))
        bad("post.arc", "an arc of 180 degrees or more; cut it in two", deg_from_rad(2 * std::atan2(u.cross(v).norm(), u.dot(v))), 180, "deg");
    }
    p_now = m.T_base_tool.p_mm;
  }
  void operator()(const SpindleOn& s) {
    is_spinning = true;
    if (!tool) return bad("post.order", "the spindle is switched before a tool is set");
    if (!std::isfinite(s.rpm) || s.rpm < std::max(1.0, 0.001 * tool->spindle.max_rpm) || s.rpm > tool->spindle.max_rpm)
      bad("post.spindle", "the spindle speed is not between a thousandth and the whole of the spindle's max_rpm; change the recipe or the cell",
          std::isfinite(s.rpm) ? s.rpm : 0, tool->spindle.max_rpm, "rpm");
  }
  void operator()(const SpindleOff&) {
    is_spinning = false;
    if (!tool) bad("post.order", "the spindle is switched before a tool is set");
  }
  void operator()(const SetOutput& s) {
    if (!limits.has_outputs) return;
    if (s.output < 1 || s.output > 4096) bad("post.output", "digital outputs are numbered from 1 to 4096", s.output, 4096);
    if (tool && tool->spindle.output == s.output)
      bad("post.output", "output " + std::to_string(s.output) + " switches the spindle; use SpindleOn and SpindleOff", s.output);
  }
  void operator()(const MoveSpline& m) {
    ready_to_move(true);
    if (!is_finite(m.T_base_tool)) bad("post.not_finite", "the target is no finite pose");
    const bool is_first = !is_in_spline;
    if (is_first && was_blended) bad("post.spline", "a spline begins at a rounded corner, which it cannot pass; make the move before exact");
    speed(m.speed_mm_s, 0, true);
    if (is_first && !p_now) bad("post.spline", "a spline must follow another path motion; move to its start first");
    if (p_now && (m.T_base_tool.p_mm - *p_now).norm() < 0.01)
      bad("post.spline", "two points of a spline are the same; leave one out", (m.T_base_tool.p_mm - *p_now).norm(), 0.01, "mm");
    if (is_first && (at + 1 >= program.instructions.size() || !std::holds_alternative<MoveSpline>(program.instructions[at + 1])))
      bad("post.spline", "a spline of a single point is a line; write it as one");
    is_in_spline = true;
    p_now = m.T_base_tool.p_mm;
  }
  void operator()(const OutputOnPath& o) {
    if (limits.has_outputs && (o.output < 1 || o.output > 4096)) bad("post.output", "digital outputs are numbered from 1 to 4096", o.output, 4096);
    if (tool && tool->spindle.output == o.output)
      bad("post.output", "output " + std::to_string(o.output) + " switches the spindle; use SpindleOn and SpindleOff", o.output);
    if (!limits.has_path_events)
      bad("post.trigger", "this controller fires outputs at points only; cut the path at that place", o.path_mm, 0, "mm");
    if (!std::isfinite(o.path_mm) || std::abs(o.path_mm) < 0.001)
      return bad("post.trigger", "a place on the path is a distance from the start (above 0) or the end (below 0) of the next motion", 0, 0.001, "mm");
    std::size_t k = at + 1, more = 0;
    while (k < program.instructions.size() && (std::holds_alternative<OutputOnPath>(program.instructions[k]) || std::holds_alternative<Comment>(program.instructions[k])))
      more += std::holds_alternative<OutputOnPath>(program.instructions[k++]);
    if (more >= 8) bad("post.trigger", "more than 8 outputs wait for one motion", static_cast<double>(more + 1), 8, "outputs");
    const auto* line = k < program.instructions.size() ? std::get_if<MoveLinear>(&program.instructions[k]) : nullptr;
    const auto* arc = k < program.instructions.size() ? std::get_if<MoveCircular>(&program.instructions[k]) : nullptr;
    if (!p_now || (!line && !arc)) return bad("post.trigger", "an output on the path must stand right before a straight or circular motion whose start is known");
    const double length = line ? (line->T_base_tool.p_mm - *p_now).norm() : arc_length(*p_now, arc->T_base_via.p_mm, arc->T_base_tool.p_mm);
    if (std::abs(o.path_mm) > length)
      bad("post.trigger", "the place lies beyond the motion it belongs to; put it before the motion on which it lies", std::abs(o.path_mm), length, "mm");
  }
  void operator()(const SwitchOn& s) {
    equipment(s.what, s.data);
    if (s.what == Equipment::tool_check) {
      if (was_blended) bad("post.order", "a tool check follows a rounded corner, where the controller cannot stop; make that move exact");
      return;
    }
    auto& on = is_on[static_cast<std::size_t>(s.what)];
    if (on) bad("post.order", std::string(name_of(s.what)) + " is switched on twice");
    on = true;
  }
  void operator()(const SwitchOff& s) {
    equipment(s.what, s.data);
    auto& on = is_on[static_cast<std::size_t>(s.what)];
    if (!on) bad("post.order", std::string(name_of(s.what)) + " is switched off without being on");
    on = false;
  }
  void equipment(Equipment what, int data) {
    const bool has_data = what == Equipment::arc || what == Equipment::weave || what == Equipment::tool_check;
    if (has_data ? data < 1 || data > 255 : data != 0)
      bad("post.equipment", std::string(name_of(what)) + (has_data ? " needs the number of its data on the controller, 1 to 255" : " takes no number"), data, has_data ? 255 : 0);
    if (has_data && what == Equipment::tool_check && !find_tool(context, data)) bad("post.tool", "the tool to check is not in the cell", data);
  }
  void operator()(const Wait& w) {
    if (!std::isfinite(w.time_s) || w.time_s < limits.wait_min_s || w.time_s > limits.wait_max_s)
      bad("post.wait", "the waiting time is outside what the controller takes", std::isfinite(w.time_s) ? w.time_s : 0, limits.wait_max_s, "s");
    if (was_blended) bad("post.wait", "a wait follows a rounded corner, where the controller cannot stop; make that move exact");
  }
  void operator()(const Comment& c) {
    if (!is_ascii_line(c.text)) bad("post.not_ascii", "a comment holds characters outside printable ASCII");
  }
};

}  // namespace

Refusals check(const Program& program, const PostContext& context, const Limits& limits) {
  Checker c{program, context, limits, {}};
  const std::string& n = program.name;
  const auto letter = [](char x) { return (x >= 'A' && x <= 'Z') || (x >= 'a' && x <= 'z'); };
  if (n.empty() || !letter(n[0]) || static_cast<int>(n.size()) > limits.name_length ||
      !std::all_of(n.begin(), n.end(), [&](char x) { return letter(x) || (x >= '0' && x <= '9') || x == '_'; }))
    c.out.push_back(fault("post.name", n, "a program name is a letter, then letters, digits and underscores, at most " +
                                              std::to_string(limits.name_length) + " characters; rename the item",
                          static_cast<double>(n.size()), limits.name_length, "characters"));
  for (const std::string& h : program.header)
    if (!is_ascii_line(h)) c.out.push_back(fault("post.not_ascii", n + ": header", "a header line holds characters outside printable ASCII"));
  for (c.at = 0; c.at < program.instructions.size(); ++c.at) {
    std::visit(c, program.instructions[c.at]);
    c.is_in_spline = std::holds_alternative<MoveSpline>(program.instructions[c.at]);
  }
  c.at = program.instructions.empty() ? 0 : program.instructions.size() - 1;
  if (!c.has_joint_move) c.bad("post.order", "the program holds no joint move");
  if (c.is_spinning) c.bad("post.order", "the spindle is still on at the end");
  for (const Equipment e : {Equipment::coolant, Equipment::arc, Equipment::weave, Equipment::recording})
    if (c.is_on[static_cast<std::size_t>(e)]) c.bad("post.order", std::string(name_of(e)) + " is still on at the end");
  if (c.was_blended) c.bad("post.order", "the last motion is rounded into nothing; make it exact");
  return std::move(c.out);
}

std::vector<std::string> words_of(std::string_view text) {
  std::vector<std::string> out;
  for (std::size_t i = 0; i < text.size();) {
    if (text[i] == ' ') {
      ++i;
      continue;
    }
    std::size_t j = i;
    while (j < text.size() && text[j] != ' ') ++j;
    out.emplace_back(text.substr(i, j - i));
    i = j;
  }
  return out;
}

std::optional<int> whole_number(std::string_view text) {
  int value = 0;
  const auto r = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || r.ec != std::errc() || r.ptr != text.data() + text.size()) return std::nullopt;
  return value;
}

std::vector<std::pair<Equipment, int>> equipment_of(const Program& program) {
  std::vector<std::pair<Equipment, int>> out;
  const auto add = [&](Equipment what, int data) {
    if (std::find(out.begin(), out.end(), std::pair(what, data)) == out.end()) out.emplace_back(what, data);
  };
  for (const Instruction& i : program.instructions) {
    if (const auto* s = std::get_if<SwitchOn>(&i)) add(s->what, s->data);
    if (const auto* s = std::get_if<SwitchOff>(&i)) add(s->what, s->data);
  }
  return out;
}

std::vector<std::pair<std::size_t, std::size_t>> split(const Program& program, int weight, int limit) {
  std::vector<std::pair<std::size_t, std::size_t>> runs;
  std::size_t begin = 0, last_safe = 0, first_joint = program.instructions.size();
  for (std::size_t i = 0; i < program.instructions.size(); ++i) {
    if (!std::holds_alternative<MoveJoint>(program.instructions[i])) continue;
    if (first_joint == program.instructions.size()) first_joint = i;
    if (i > first_joint && (i - begin) * weight > static_cast<std::size_t>(limit) && last_safe > begin) {
      runs.push_back({begin, last_safe});
      begin = last_safe;
    }
    if (i > first_joint) last_safe = i;
  }
  if ((program.instructions.size() - begin) * weight > static_cast<std::size_t>(limit) && last_safe > begin) {
    runs.push_back({begin, last_safe});
    begin = last_safe;
  }
  runs.push_back({begin, program.instructions.size()});
  return runs;
}

std::string module_name(const std::string& name, std::size_t k, int limit) {
  const std::string tail = "_" + std::to_string(k);
  if (static_cast<int>(name.size() + tail.size()) <= limit) return name + tail;
  const int keep = limit - static_cast<int>(tail.size()) - 7;
  if (keep < 1) return "";
  return name.substr(0, static_cast<std::size_t>(keep)) + "_" + upper(sha256_hex(name).substr(0, 6)) + tail;
}

std::string upper(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
  return out;
}

std::vector<std::string> pieces(std::string_view text, std::size_t width) {
  std::vector<std::string> out;
  do {
    out.emplace_back(text.substr(0, width));
    text.remove_prefix(std::min(width, text.size()));
  } while (!text.empty());
  return out;
}

}  // namespace asbuilt::writing
