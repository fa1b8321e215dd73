// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/support/post_programs.hpp"

#include <cmath>
#include <map>

#include "planner/base/number.hpp"

namespace asbuilt::support {

PostContext post_context() {
  PostContext c;
  c.date = "2026-11-22";
  c.cell.id = "test-cell";
  OpwParameters k;
  k.a1_mm = 300, k.a2_mm = -150, k.c1_mm = 750, k.c2_mm = 1000, k.c3_mm = 1080, k.c4_mm = 220;
  k.offsets_rad = {0, -kPi / 2, 0, 0, 0, 0};
  k.signs = {-1, 1, 1, -1, 1, -1};
  c.cell.robot.kinematics = k;
  const double lo[] = {-180, -150, -110, -270, -122, -350}, hi[] = {180, 20, 150, 270, 122, 350}, v[] = {120, 115, 120, 190, 180, 260};
  for (int i = 0; i < 6; ++i) {
    JointSpec& j = c.cell.robot.joints[i];
    j.min_rad = rad_from_deg(lo[i]), j.max_rad = rad_from_deg(hi[i]), j.speed_rad_s = rad_from_deg(v[i]);
    c.cell.robot.home_rad[i] = rad_from_deg(std::array<double, 6>{0, -100, 100, 0, 90, 0}[i]);
  }
  ToolSpec a;
  a.id = "cone-90", a.number = 1;
  a.T_flange_tool = {quat_from_zyx(0.3, -0.2, 0.1), Vec3(12.34567, -7.65432, 350.11111)};
  a.spindle = {16000, 5, 1};
  ToolSpec b = a;
  b.id = "ball-6", b.number = 3;
  b.T_flange_tool = {quat_from_zyx(kPi, 0, 0), Vec3(-100, 0.0004, 251)};
  b.spindle = {40000, 6, 2};
  c.cell.tools = {a, b};
  ControllerSpec& s = c.cell.controller;
  s.pulses_per_degree = {{1435.64, 1435.64, 1365.33, 1137.78, 1137.78, 910.22}};
  s.speed_unit = SpeedUnit::mm_s;
  s.orientation = BeckhoffOrientation::cba;
  s.kinematic_id = 45;
  s.options["beckhoff.output.7"] = "70 71";
  s.options["beckhoff.output.12"] = "120 121";
  // what else the program may switch
  for (const auto& [key, value] : std::map<std::string, std::string>{
           {"krl.coolant", "9"}, {"krl.arc", "ARC_START ARC_END"}, {"krl.weave", "WEAVE_ON WEAVE_OFF"}, {"krl.recording", "LOG_START LOG_STOP"}, {"krl.tool_check", "CHECK_TOOL"},
           {"inform.coolant", "9"}, {"inform.arc", "1 2 3"}, {"inform.weave", "1 2 3"}, {"inform.recording", "LOGON LOGOFF"}, {"inform.tool_check", "TOOLCHK"},
           {"beckhoff.coolant", "8 9"}, {"beckhoff.recording", "150 151"}, {"beckhoff.hsc_path_dev", "0.010"}, {"beckhoff.tool_check.1", "61"}, {"beckhoff.tool_check.3", "63"},
           {"nci.coolant", "8 9"}, {"nci.recording", "150 151"}, {"nci.tool_check.1", "61"}, {"nci.tool_check.3", "63"}, {"nci.output.7", "70 71"}, {"nci.output.12", "120 121"},
           {"nci.orientation", "cba"}, {"nci.kinematics", "40 41"}, {"nci.wrap", "positive"},
           {"ur.acceleration", "1.2"}, {"ur.joint_acceleration", "1.4"}})
    s.options[key] = value;
  for (int n = 1; n <= 3; ++n)
    for (const char* dialect : {"beckhoff.", "nci."}) {
      s.options[dialect + std::string("arc.") + std::to_string(n)] = std::to_string(100 + 2 * n) + " " + std::to_string(101 + 2 * n);
      s.options[dialect + std::string("weave.") + std::to_string(n)] = std::to_string(130 + 2 * n) + " " + std::to_string(131 + 2 * n);
    }
  return c;
}

Eigen::Quaterniond random_rotation(Random& r) {
  if (r.below(8) == 0) {
    Eigen::Quaterniond q(Eigen::AngleAxisd(kPi / 2 * static_cast<double>(r.below(4)), Vec3::UnitZ()) *
                         Eigen::AngleAxisd(kPi / 2 * static_cast<double>(r.below(4)), Vec3::UnitY()) *
                         Eigen::AngleAxisd(kPi / 2 * static_cast<double>(r.below(4)), Vec3::UnitX()));
    if (r.below(2)) q = q * Eigen::Quaterniond(Eigen::AngleAxisd(r.uniform(-kPi, kPi), Vec3::Unit(static_cast<int>(r.below(3)))));
    return q.normalized();
  }
  Eigen::Quaterniond q(r.normal(), r.normal(), r.normal(), r.normal());
  return q.normalized();
}

Program random_program(std::uint64_t seed, const ProgramMix& mix) {
  Random r = Random::stream(seed, "post program");
  const PostContext context = post_context();
  Program p;
  p.name = "PART_" + std::to_string(seed % 100000);
  p.header = {"item part-" + std::to_string(seed), "calibration 2026-11-20 sha256 0123456789abcdef0123456789abcdef0123456789abcdef"};
  auto& out = p.instructions;
  const auto tool = [&](int i) { out.emplace_back(SetTool{context.cell.tools[i].number, context.cell.tools[i].T_flange_tool}); };
  int tool_now = 0;
  tool(0);
  Pose<frame::Base, frame::Work> T_base_work;
  const auto frame = [&] {
    T_base_work = {mix.is_upright ? Eigen::Quaterniond::Identity() : random_rotation(r), Vec3(r.uniform(-1500, 1500), r.uniform(-1500, 1500), r.uniform(-200, 1500))};
    out.emplace_back(SetFrame{T_base_work});
  };
  frame();
  const auto joint = [&] {
    MoveJoint m;
    for (int i = 0; i < 6; ++i) m.q_rad[i] = r.uniform(context.cell.robot.joints[i].min_rad, context.cell.robot.joints[i].max_rad);
    m.speed_ratio = r.uniform(0.05, 1.0);
    if (r.below(4) == 0) m.q_rad = context.cell.robot.home_rad, m.q_rad[3] = -1e-9;
    out.emplace_back(m);
  };
  const auto home = [&] { out.emplace_back(MoveJoint{context.cell.robot.home_rad, 0.3}); };
  home();
  Vec3 p_work = Vec3::Zero();
  Eigen::Quaterniond q_work, q_section;
  bool was_blended = false;
  const auto pose = [&](const Vec3& point, const Eigen::Quaterniond& q) { return T_base_work * Pose<frame::Work, frame::Tool>(q, point); };
  const auto line = [&](bool must_stop) {
    MoveLinear m;
    p_work += Vec3(r.normal(), r.normal(), r.normal()) * 20;
    if (r.below(10) == 0) p_work[static_cast<int>(r.below(3))] = -1e-5;  // prints as zero, never as -0
    q_work = ((mix.is_upright ? q_section : q_work) * quat_exp(Vec3(r.normal(), r.normal(), r.normal()) * 0.05)).normalized();  // an upright tool does not wander off
    m.T_base_tool = pose(p_work, q_work);
    m.speed_mm_s = r.uniform(0.5, 200);
    m.is_exact = must_stop || r.below(2) == 0;
    m.blend_mm = m.is_exact ? 0 : r.uniform(0.2, 5);
    was_blended = !m.is_exact;
    out.emplace_back(m);
  };
  const auto arc = [&](bool must_stop) {
    const double radius = r.uniform(5, 200), start = r.uniform(-kPi, kPi), turn = r.uniform(0.4, 2.8) * (r.below(2) ? 1 : -1);
    const int axis = static_cast<int>(r.below(3)), u = (axis + 1) % 3, v = (axis + 2) % 3;
    Vec3 centre = p_work;
    centre[u] -= radius * std::cos(start), centre[v] -= radius * std::sin(start);
    const auto at = [&](double f) {
      Vec3 x = centre;
      x[u] += radius * std::cos(start + f * turn), x[v] += radius * std::sin(start + f * turn);
      return x;
    };
    MoveCircular m;
    m.T_base_via = pose(at(r.uniform(0.4, 0.6)), q_work);
    p_work = at(1);
    m.T_base_tool = pose(p_work, q_work);
    m.speed_mm_s = r.uniform(0.5, 200);
    m.is_exact = must_stop || r.below(2) == 0;
    m.blend_mm = m.is_exact ? 0 : r.uniform(0.2, 2);
    was_blended = !m.is_exact;
    out.emplace_back(m);
  };
  const auto spline = [&] {
    const int count = 2 + static_cast<int>(r.below(4));
    for (int k = 0; k < count; ++k) {
      p_work += Vec3(r.uniform(2, 10), r.normal(), r.normal());
      q_work = (q_work * quat_exp(Vec3(r.normal(), r.normal(), r.normal()) * 0.02)).normalized();
      out.emplace_back(MoveSpline{pose(p_work, q_work), r.uniform(0.5, 100)});
    }
    was_blended = false;
  };
  const auto trigger = [&] {  // before a line of its own
    const Vec3 step = Vec3(r.normal(), r.normal(), r.normal()) * 20;
    if (step.norm() < 1) return;
    const int n = 1 + static_cast<int>(r.below(3));
    for (int k = 0; k < n; ++k) out.emplace_back(OutputOnPath{r.below(2) ? 7 : 12, r.below(2) == 0, (r.below(2) ? 1 : -1) * r.uniform(0.1, 0.99 * step.norm())});
    p_work += step;
    was_blended = r.below(2) == 0;
    out.emplace_back(MoveLinear{pose(p_work, q_work), r.uniform(0.5, 200), !was_blended, was_blended ? r.uniform(0.2, 5) : 0});
  };
  std::array<int, 5> data{};  // of what is on; -1 for those without a number
  const auto switched = [&](Equipment what) {
    int& on = data[static_cast<std::size_t>(what)];
    const bool has_number = what == Equipment::arc || what == Equipment::weave;
    if (on) {
      out.emplace_back(SwitchOff{what, has_number ? on : 0});
      on = 0;
    } else {
      on = has_number ? 1 + static_cast<int>(r.below(3)) : -1;
      out.emplace_back(SwitchOn{what, has_number ? on : 0});
    }
  };
  const auto has_event_at_corner = [&] {  // not every dialect fires something between a rounded corner and an arc
    if (!was_blended) return false;
    for (auto i = out.rbegin(); i != out.rend(); ++i) {
      if (std::holds_alternative<Comment>(*i)) continue;
      return !std::holds_alternative<MoveLinear>(*i) && !std::holds_alternative<MoveCircular>(*i);
    }
    return false;
  };
  const auto event = [&] {
    switch (r.below(4)) {
      case 0: out.emplace_back(SetOutput{r.below(2) ? 7 : 12, r.below(2) == 0}); break;
      case 1: if (!was_blended) out.emplace_back(Wait{r.uniform(0.02, 5)}); break;
      case 2: out.emplace_back(Comment{"edge e" + std::to_string(r.below(100))}); break;
      default: out.emplace_back(Comment{"a remark that is far longer than a line of thirty-two characters, no " + std::to_string(r.below(1000))});
    }
  };
  for (int s = 0; s < mix.sections; ++s) {
    joint();
    if (mix.has_new_frames && s && r.below(2)) frame();
    if (mix.has_two_tools && s && r.below(3) == 0) tool(tool_now = 1 - tool_now), joint();
    out.emplace_back(SpindleOn{std::round(r.uniform(1000, 15000))});
    out.emplace_back(Wait{1.5});
    p_work = Vec3(r.uniform(-300, 300), r.uniform(-300, 300), r.uniform(-300, 300));
    q_work = mix.is_upright ? quat_from_zyx(r.uniform(-1.2, 1.2), r.uniform(-0.7, 0.7), r.uniform(-1.2, 1.2)) : random_rotation(r);
    q_section = q_work;
    line(true);
    for (int i = 0; i < mix.points; ++i) {
      const bool is_last = i + 1 == mix.points;
      if (mix.has_arcs && r.below(4) == 0 && !has_event_at_corner())
        arc(is_last);
      else
        line(is_last);
      if (mix.has_splines && !is_last && !was_blended && !data[static_cast<std::size_t>(Equipment::arc)] && r.below(8) == 0) spline();
      if (mix.has_triggers && !is_last && r.below(6) == 0) trigger();
      if (mix.has_equipment && r.below(5) == 0) switched(static_cast<Equipment>(r.below(4)));
      if (mix.has_events && r.below(5) == 0) event();
    }
    for (const Equipment e : {Equipment::arc, Equipment::weave, Equipment::recording, Equipment::coolant})
      if (data[static_cast<std::size_t>(e)]) switched(e);
    out.emplace_back(SpindleOff{});
    if (mix.has_equipment && r.below(3) == 0) out.emplace_back(SwitchOn{Equipment::tool_check, context.cell.tools[static_cast<std::size_t>(tool_now)].number});
  }
  home();
  return p;
}

ProgramMix mix_for(const Post& post, ProgramMix mix) {
  if (post.arcs == Post::Arcs::in_planes_of_base) mix.is_upright = true;
  mix.has_splines &= post.has_splines;
  mix.has_equipment &= post.has_equipment;
  mix.has_triggers &= post.has_path_events;
  return mix;
}
bool prints_in_base(const Post& post, const PostContext& context) {
  return post.is_in_base || (post.language == Language::inform && !context.cell.controller.options.count("inform.user_frame"));
}

Tolerance tolerance_of(const Post& post, const PostContext& context) {
  Tolerance t;
  const double slack = 1.0001;
  t.position_mm = post.position_step_mm / 2 * slack + 1e-9;
  t.angle_rad = post.angle_step_rad * 0.8661 * slack + 1e-9;  // three printed angles, half a digit each
  t.speed_mm_s = post.speed_step_mm_s / 2 * slack;
  t.joint_rad = post.joint_step_rad(context);
  for (double& j : t.joint_rad) j = j / 2 * slack;
  double max_rpm = 0;
  for (const ToolSpec& tool : context.cell.tools) max_rpm = std::max(max_rpm, tool.spindle.max_rpm);
  t.speed_ratio = post.joint_speed_step_ratio / 2 * slack;
  t.rpm = post.spindle_step_ratio * max_rpm / 2 * slack;
  t.is_via_printed = post.arcs == Post::Arcs::anywhere;
  t.is_rounding_kept = post.has_rounding;
  t.time_s = post.time_step_s / 2 * slack;
  t.blend_mm = post.blend_step_mm / 2 * slack;
  return t;
}

std::string text_of(const Refusals& refusals) {
  std::string s;
  for (const Refusal& r : refusals) s += r.code + " at " + r.where + ": " + r.message + "\n";
  return s;
}

namespace {

struct Flat {  // the program as a list of what happens, frames and repeated settings taken out
  std::vector<const Instruction*> steps;
  std::vector<Pose<frame::Base, frame::Work>> frame;
  std::vector<int> tool;
  std::string remarks;  // a dialect may move a remark past an event beside it: remarks are compared as a list of their own
};
Flat flatten(const Program& p, std::vector<Instruction>& kept) {
  Flat f;
  Pose<frame::Base, frame::Work> T;
  int tool = -1;
  double rpm = -1;
  std::string comment;
  kept.reserve(p.instructions.size());
  for (const Instruction& i : p.instructions) {
    if (const auto* s = std::get_if<SetTool>(&i)) {
      tool = s->number;
      continue;
    }
    if (const auto* s = std::get_if<SetFrame>(&i)) {
      T = s->T_base_work;
      continue;
    }
    if (const auto* s = std::get_if<SpindleOn>(&i)) {
      if (s->rpm == rpm) continue;
      rpm = s->rpm;
    }
    if (std::holds_alternative<SpindleOff>(i)) rpm = -1;
    if (const auto* c = std::get_if<Comment>(&i)) {
      f.remarks += c->text + "\n";
      continue;
    }
    kept.push_back(i);
    f.steps.push_back(&kept.back());
    f.frame.push_back(T);
    f.tool.push_back(tool);
  }
  return f;
}

std::string number(double v) { return shortest_number(v); }

struct Compare {
  const Tolerance& t;
  const Pose<frame::Base, frame::Work>& T_base_work;
  bool is_in_base;
  std::optional<Vec3> p_before_wanted;

  std::string pose(const Pose<frame::Base, frame::Tool>& a, const Pose<frame::Base, frame::Tool>& b, double more = 1) const {
    Vec3 d = b.p_mm - a.p_mm;
    if (!is_in_base) d = T_base_work.q.conjugate() * d;
    if (d.cwiseAbs().maxCoeff() > t.position_mm * more) return "position off by " + number(d.cwiseAbs().maxCoeff()) + " mm";
    const double angle = quat_log(a.q.conjugate() * b.q).norm();
    if (angle > t.angle_rad) return "orientation off by " + number(angle) + " rad";
    return "";
  }
  std::string path(double va, double vb, bool ea, bool eb, double ba, double bb) const {
    if (std::abs(va - vb) > t.speed_mm_s) return "speed " + number(vb) + " instead of " + number(va);
    if (!t.is_rounding_kept && eb) return "";  // stops where it may go round: never the other way
    ea = ea || ba <= t.blend_mm;  // a distance that prints as 0 is none
    if (ea != eb) return "exactness differs";
    if (!ea && std::abs(ba - bb) > t.blend_mm) return "rounding " + number(bb) + " instead of " + number(ba);
    return "";
  }
  template <class A, class B>
  std::string operator()(const A&, const B&) const {
    return "another kind of instruction";
  }
  std::string operator()(const MoveJoint& a, const MoveJoint& b) const {
    for (int i = 0; i < 6; ++i)
      if (std::abs(a.q_rad[i] - b.q_rad[i]) > t.joint_rad[i]) return "joint " + std::to_string(i + 1) + " off by " + number(b.q_rad[i] - a.q_rad[i]) + " rad";
    if (std::abs(a.speed_ratio - b.speed_ratio) > t.speed_ratio + 1e-9) return "joint speed " + number(b.speed_ratio) + " instead of " + number(a.speed_ratio);
    return "";
  }
  std::string operator()(const MoveLinear& a, const MoveLinear& b) const {
    const std::string s = pose(a.T_base_tool, b.T_base_tool);
    return s.empty() ? path(a.speed_mm_s, b.speed_mm_s, a.is_exact, b.is_exact, a.blend_mm, b.blend_mm) : s;
  }
  std::string operator()(const MoveCircular& a, const MoveCircular& b) const {
    std::string s = pose(a.T_base_tool, b.T_base_tool);
    if (!s.empty()) return s;
    if (t.is_via_printed) {
      const std::string via = pose(a.T_base_via, b.T_base_via);
      return via.empty() ? path(a.speed_mm_s, b.speed_mm_s, a.is_exact, b.is_exact, a.blend_mm, b.blend_mm) : "middle of the arc: " + via;
    }
    // any point of the arc may be named: the circle through a's points must hold b's
    const Vec3 u = a.T_base_via.p_mm - *p_before_wanted, v = a.T_base_tool.p_mm - *p_before_wanted, n = u.cross(v);
    const Vec3 c = *p_before_wanted + (v.squaredNorm() * n.cross(u) + u.squaredNorm() * v.cross(n)) / (2 * n.squaredNorm());
    const double radius = (a.T_base_tool.p_mm - c).norm();
    const Vec3 d = b.T_base_via.p_mm - c;
    const double off = std::hypot(d.norm() - radius, d.dot(n.normalized()));
    const double spread = radius / std::max(1e-9, n.norm() / v.norm());  // how far the digits of three points move the circle
    if (off > t.position_mm * (4 + 2 * spread)) return "arc off by " + number(off) + " mm";
    if (d.dot(a.T_base_via.p_mm - c) < 0) return "arc goes the other way";
    return path(a.speed_mm_s, b.speed_mm_s, a.is_exact, b.is_exact, a.blend_mm, b.blend_mm);
  }
  std::string operator()(const SpindleOn& a, const SpindleOn& b) const {
    return std::abs(a.rpm - b.rpm) <= t.rpm ? "" : "spindle " + number(b.rpm) + " instead of " + number(a.rpm);
  }
  std::string operator()(const MoveSpline& a, const MoveSpline& b) const {
    const std::string s = pose(a.T_base_tool, b.T_base_tool);
    return s.empty() ? path(a.speed_mm_s, b.speed_mm_s, true, true, 0, 0) : s;
  }
  std::string operator()(const OutputOnPath& a, const OutputOnPath& b) const {
    if (a.output != b.output || a.value != b.value) return "another output";
    return std::abs(a.path_mm - b.path_mm) <= t.position_mm ? "" : "fires at " + number(b.path_mm) + " instead of " + number(a.path_mm) + " mm";
  }
  std::string operator()(const SwitchOn& a, const SwitchOn& b) const { return a.what == b.what && a.data == b.data ? "" : "another switch"; }
  std::string operator()(const SwitchOff& a, const SwitchOff& b) const { return a.what == b.what && a.data == b.data ? "" : "another switch"; }
  std::string operator()(const SpindleOff&, const SpindleOff&) const { return ""; }
  std::string operator()(const SetOutput& a, const SetOutput& b) const {
    return a.output == b.output && a.value == b.value ? "" : "another output";
  }
  std::string operator()(const Wait& a, const Wait& b) const {
    return std::abs(a.time_s - b.time_s) <= t.time_s + 1e-9 ? "" : "wait " + number(b.time_s) + " instead of " + number(a.time_s);
  }
  std::string operator()(const Comment& a, const Comment& b) const { return a.text == b.text ? "" : "comment \"" + b.text + "\""; }
};

}  // namespace

std::string difference(const Program& wanted, const Program& got, const Tolerance& tolerance, bool is_in_base) {
  const auto fold = [](std::string s) {
    for (char& c : s) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    return s;
  };
  if (fold(wanted.name) != fold(got.name)) return "name " + got.name;
  if (wanted.header != got.header) return "header differs";
  std::vector<Instruction> keep_a, keep_b;
  const Flat a = flatten(wanted, keep_a), b = flatten(got, keep_b);
  std::optional<Vec3> before;
  for (std::size_t i = 0; i < std::min(a.steps.size(), b.steps.size()); ++i) {
    const Compare c{tolerance, a.frame[i], is_in_base, before};
    std::string d = std::visit(c, *a.steps[i], *b.steps[i]);
    const bool needs_tool = !std::holds_alternative<Comment>(*a.steps[i]) && !std::holds_alternative<Wait>(*a.steps[i]) && !std::holds_alternative<SetOutput>(*a.steps[i]);
    if (d.empty() && needs_tool && a.tool[i] != b.tool[i]) d = "another tool";
    if (!d.empty()) return "step " + std::to_string(i + 1) + ": " + d;
    if (const auto* m = std::get_if<MoveLinear>(a.steps[i])) before = m->T_base_tool.p_mm;
    if (const auto* m = std::get_if<MoveSpline>(a.steps[i])) before = m->T_base_tool.p_mm;
    if (const auto* m = std::get_if<MoveCircular>(a.steps[i])) before = m->T_base_tool.p_mm;
  }
  if (a.remarks != b.remarks) return "remarks differ";
  if (a.steps.size() != b.steps.size())
    return std::to_string(b.steps.size()) + " steps instead of " + std::to_string(a.steps.size());
  return "";
}

}  // namespace asbuilt::support
