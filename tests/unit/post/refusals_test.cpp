// SPDX-License-Identifier: GPL-3.0-or-later
// What a post must not write: every post.* refusal has a program or a machine file that provokes it.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <limits>

#include "tests/support/post_programs.hpp"

namespace asbuilt {
namespace {

using namespace support;

struct Case {
  const char* name;
  const char* code;
  const char* where;  // a part of Refusal::where
  std::vector<Language> languages;
  std::function<void(Program&, PostContext&)> spoil;
};

const std::vector<Language> kAll = {Language::krl, Language::inform, Language::beckhoff};

template <class T>
T& first(Program& p) {
  for (Instruction& i : p.instructions)
    if (auto* m = std::get_if<T>(&i)) return *m;
  throw Bug("no such instruction");
}

/// The instruction put behind the first exact straight move.
void insert_on_path(Program& p, std::vector<Instruction> more) {
  for (std::size_t i = 0; i < p.instructions.size(); ++i)
    if (auto* m = std::get_if<MoveLinear>(&p.instructions[i])) {
      m->is_exact = true;
      p.instructions.insert(p.instructions.begin() + static_cast<long>(i) + 1, more.begin(), more.end());
      return;
    }
}
Pose<frame::Base, frame::Tool> beside(Program& p, const Vec3& d) {
  auto T = first<MoveLinear>(p).T_base_tool;
  T.p_mm += d;
  return T;
}
void switch_twice(Program& p, Equipment what, int data) { insert_on_path(p, {SwitchOn{what, data}, SwitchOff{what, data}}); }

const std::vector<Language> kAllFour = {Language::krl, Language::inform, Language::beckhoff, Language::nci};

const Case kCases[] = {
    {"krl_no_arc", "post.missing_value", "controller.krl.arc", {Language::krl}, [](Program& p, PostContext& c) { c.cell.controller.options.erase("krl.arc"), switch_twice(p, Equipment::arc, 1); }},
    {"krl_arc_names", "post.option", "controller.krl.arc", {Language::krl}, [](Program& p, PostContext& c) { c.cell.controller.options["krl.arc"] = "ONE", switch_twice(p, Equipment::arc, 1); }},
    {"krl_no_coolant", "post.missing_value", "controller.krl.coolant", {Language::krl}, [](Program& p, PostContext& c) { c.cell.controller.options.erase("krl.coolant"), switch_twice(p, Equipment::coolant, 0); }},
    {"krl_coolant", "post.option", "controller.krl.coolant", {Language::krl}, [](Program& p, PostContext& c) { c.cell.controller.options["krl.coolant"] = "x", switch_twice(p, Equipment::coolant, 0); }},
    {"krl_no_tool_check", "post.missing_value", "controller.krl.tool_check", {Language::krl},
     [](Program& p, PostContext& c) { c.cell.controller.options.erase("krl.tool_check"), insert_on_path(p, {SwitchOn{Equipment::tool_check, 1}}); }},
    {"krl_delivery", "post.option", "controller.krl.delivery", {Language::krl}, [](Program&, PostContext& c) { c.cell.controller.options["krl.delivery"] = "both"; }},
    {"krl_cell", "post.option", "controller.krl.cell", {Language::krl}, [](Program&, PostContext& c) { c.cell.controller.options["krl.cell"] = "0"; }},
    {"krc2_spline_block", "post.spline", "", {Language::krl},
     [](Program& p, PostContext& c) { c.cell.controller.options["krl.version"] = "KRC2", insert_on_path(p, {MoveSpline{beside(p, {3, 0, 0}), 10}, MoveSpline{beside(p, {6, 1, 0}), 10}}); }},
    {"krc2_trigger", "post.trigger", "", {Language::krl},
     [](Program& p, PostContext& c) { c.cell.controller.options["krl.version"] = "KRC2", insert_on_path(p, {OutputOnPath{7, true, 2}, MoveLinear{beside(p, {9, 0, 0}), 10, true, 0}}); }},
    {"inform_no_arc", "post.missing_value", "controller.inform.arc", {Language::inform}, [](Program& p, PostContext& c) { c.cell.controller.options.erase("inform.arc"), switch_twice(p, Equipment::arc, 1); }},
    {"inform_arc_list", "post.option", "controller.inform.arc", {Language::inform}, [](Program& p, PostContext&) { switch_twice(p, Equipment::arc, 9); }},
    {"inform_no_weave", "post.missing_value", "controller.inform.weave", {Language::inform}, [](Program& p, PostContext& c) { c.cell.controller.options.erase("inform.weave"), switch_twice(p, Equipment::weave, 1); }},
    {"inform_recording", "post.option", "controller.inform.recording", {Language::inform}, [](Program& p, PostContext& c) { c.cell.controller.options["inform.recording"] = "log on", switch_twice(p, Equipment::recording, 0); }},
    {"inform_no_recording", "post.missing_value", "controller.inform.recording", {Language::inform}, [](Program& p, PostContext& c) { c.cell.controller.options.erase("inform.recording"), switch_twice(p, Equipment::recording, 0); }},
    {"inform_relative", "post.option", "controller.inform.relative", {Language::inform}, [](Program&, PostContext& c) { c.cell.controller.options["inform.relative"] = "maybe"; }},
    {"inform_arc_spline", "post.spline", "", {Language::inform},
     [](Program& p, PostContext&) { insert_on_path(p, {SwitchOn{Equipment::arc, 1}, MoveSpline{beside(p, {3, 0, 0}), 10}, MoveSpline{beside(p, {6, 1, 0}), 10}, SwitchOff{Equipment::arc, 1}}); }},
    {"inform_event_at_corner", "post.trigger", "", {Language::inform},
     [](Program& p, PostContext&) {
       insert_on_path(p, {MoveLinear{beside(p, {9, 0, 0}), 10, false, 1}, SetOutput{7, true}, MoveCircular{beside(p, {12, 1, 0}), beside(p, {15, 0, 0}), 10, true, 0}, SetOutput{7, false}});
     }},
    {"beckhoff_no_arc", "post.missing_value", "controller.beckhoff.arc.9", {Language::beckhoff}, [](Program& p, PostContext&) { switch_twice(p, Equipment::arc, 9); }},
    {"beckhoff_no_hsc", "post.missing_value", "controller.beckhoff.hsc_path_dev", {Language::beckhoff},
     [](Program& p, PostContext& c) { c.cell.controller.options.erase("beckhoff.hsc_path_dev"), insert_on_path(p, {MoveSpline{beside(p, {3, 0, 0}), 10}, MoveSpline{beside(p, {6, 1, 0}), 10}}); }},
    {"beckhoff_hsc", "post.option", "controller.beckhoff.hsc_path_dev", {Language::beckhoff}, [](Program&, PostContext& c) { c.cell.controller.options["beckhoff.hsc_path_dev"] = "wide"; }},
    {"beckhoff_delivery", "post.option", "controller.beckhoff.delivery", {Language::beckhoff}, [](Program&, PostContext& c) { c.cell.controller.options["beckhoff.delivery"] = "x"; }},
    {"nci_no_kinematics", "post.missing_value", "controller.nci.kinematics", {Language::nci}, [](Program&, PostContext& c) { c.cell.controller.options.erase("nci.kinematics"); }},
    {"nci_kinematics", "post.option", "controller.nci.kinematics", {Language::nci}, [](Program&, PostContext& c) { c.cell.controller.options["nci.kinematics"] = "30 31"; }},
    {"nci_no_orientation", "post.missing_value", "controller.nci.orientation", {Language::nci}, [](Program&, PostContext& c) { c.cell.controller.options.erase("nci.orientation"); }},
    {"nci_orientation", "post.option", "controller.nci.orientation", {Language::nci}, [](Program&, PostContext& c) { c.cell.controller.options["nci.orientation"] = "abc"; }},
    {"nci_no_output", "post.missing_value", "controller.nci.output.9", {Language::nci}, [](Program& p, PostContext&) { insert_on_path(p, {SetOutput{9, true}}); }},
    {"nci_spline", "post.spline", "", {Language::nci}, [](Program& p, PostContext&) { insert_on_path(p, {MoveSpline{beside(p, {3, 0, 0}), 10}, MoveSpline{beside(p, {6, 1, 0}), 10}}); }},
    {"nci_wrap", "post.option", "controller.nci.wrap", {Language::nci}, [](Program&, PostContext& c) { c.cell.controller.options["nci.wrap"] = "x"; }},
    {"nci_first_angle", "post.missing_value", "controller.nci.wrap", {Language::nci},
     [](Program& p, PostContext& c) {
       c.cell.controller.options.erase("nci.wrap");
       for (Instruction& i : p.instructions)
         if (auto* m = std::get_if<MoveLinear>(&i)) m->T_base_tool.q = quat_from_zyx(0, 0, rad_from_deg(179.9));
     }},
    {"nci_angle_wrap", "post.angle_wrap", "", {Language::nci},
     [](Program& p, PostContext&) {
       int n = 0;
       for (Instruction& i : p.instructions)
         if (auto* m = std::get_if<MoveLinear>(&i)) m->T_base_tool.q = quat_from_zyx(0, 0, rad_from_deg(179.9 + 0.2 * n++));
     }},
    {"nci_pole", "post.pole", "", {Language::nci},
     [](Program& p, PostContext&) {
       for (Instruction& i : p.instructions)
         if (auto* m = std::get_if<MoveLinear>(&i)) m->T_base_tool.q = quat_from_zyx(0, rad_from_deg(89.95), 0);
     }},
    {"nci_arc_in_no_plane", "post.arc_plane", "", {Language::nci},
     [](Program& p, PostContext&) { insert_on_path(p, {MoveCircular{beside(p, {10, 3, 2}), beside(p, {20, -1, 7}), 10, true, 0}}); }},
    {"nci_unknown_option", "post.option", "controller.nci.mode", {Language::nci}, [](Program&, PostContext& c) { c.cell.controller.options["nci.mode"] = "0"; }},
    {"ur_no_acceleration", "post.missing_value", "controller.ur.acceleration", {Language::ur}, [](Program&, PostContext& c) { c.cell.controller.options.erase("ur.acceleration"); }},
    {"ur_acceleration", "post.option", "controller.ur.joint_acceleration", {Language::ur}, [](Program&, PostContext& c) { c.cell.controller.options["ur.joint_acceleration"] = "fast"; }},
    {"ur_spindle", "post.missing_value", "spindle", {Language::ur}, [](Program&, PostContext& c) { c.cell.tools[0].spindle.output = 9; }},
    {"ur_spline", "post.spline", "", {Language::ur}, [](Program& p, PostContext&) { insert_on_path(p, {MoveSpline{beside(p, {3, 0, 0}), 10}, MoveSpline{beside(p, {6, 1, 0}), 10}}); }},
    {"ur_equipment", "post.equipment", "", {Language::ur}, [](Program& p, PostContext&) { switch_twice(p, Equipment::coolant, 0); }},
    {"ur_output", "post.output", "", {Language::ur}, [](Program& p, PostContext&) { insert_on_path(p, {SetOutput{16, true}}); }},
    {"spline_of_one_point", "post.spline", "", kAllFour, [](Program& p, PostContext&) { insert_on_path(p, {MoveSpline{beside(p, {3, 0, 0}), 10}}); }},
    {"spline_of_a_point_twice", "post.spline", "", kAllFour,
     [](Program& p, PostContext&) { insert_on_path(p, {MoveSpline{beside(p, {3, 0, 0}), 10}, MoveSpline{beside(p, {3, 0, 0}), 10}}); }},
    {"spline_at_a_rounded_corner", "post.spline", "", kAllFour,
     [](Program& p, PostContext&) { insert_on_path(p, {MoveLinear{beside(p, {1, 1, 0}), 10, false, 1}, MoveSpline{beside(p, {3, 0, 0}), 10}, MoveSpline{beside(p, {6, 1, 0}), 10}}); }},
    {"spline_after_a_joint_move", "post.spline", "", kAllFour,
     [](Program& p, PostContext& c) { insert_on_path(p, {MoveJoint{c.cell.robot.home_rad, 0.3}, MoveSpline{beside(p, {3, 0, 0}), 10}, MoveSpline{beside(p, {6, 1, 0}), 10}}); }},
    {"place_beyond_the_motion", "post.trigger", "", kAllFour, [](Program& p, PostContext&) { insert_on_path(p, {OutputOnPath{7, true, -20}, MoveLinear{beside(p, {9, 0, 0}), 10, true, 0}}); }},
    {"place_without_a_motion", "post.trigger", "", kAllFour, [](Program& p, PostContext&) { insert_on_path(p, {OutputOnPath{7, true, 2}, SetOutput{7, false}}); }},
    {"place_of_no_length", "post.trigger", "", kAllFour, [](Program& p, PostContext&) { insert_on_path(p, {OutputOnPath{7, true, 0}, MoveLinear{beside(p, {9, 0, 0}), 10, true, 0}}); }},
    {"no_path_events", "post.trigger", "", {Language::inform, Language::beckhoff, Language::nci},
     [](Program& p, PostContext&) { insert_on_path(p, {OutputOnPath{7, true, 2}, MoveLinear{beside(p, {9, 0, 0}), 10, true, 0}}); }},
    {"spindle_on_the_path", "post.output", "", kAllFour, [](Program& p, PostContext&) { insert_on_path(p, {OutputOnPath{5, true, 2}, MoveLinear{beside(p, {9, 0, 0}), 10, true, 0}}); }},
    {"arc_without_data", "post.equipment", "", kAllFour, [](Program& p, PostContext&) { switch_twice(p, Equipment::arc, 0); }},
    {"coolant_with_data", "post.equipment", "", kAllFour, [](Program& p, PostContext&) { switch_twice(p, Equipment::coolant, 2); }},
    {"recording_on_twice", "post.order", "", kAllFour,
     [](Program& p, PostContext&) { insert_on_path(p, {SwitchOn{Equipment::recording, 0}, SwitchOn{Equipment::recording, 0}, SwitchOff{Equipment::recording, 0}}); }},
    {"weave_off_alone", "post.order", "", kAllFour, [](Program& p, PostContext&) { insert_on_path(p, {SwitchOff{Equipment::weave, 1}}); }},
    {"coolant_on_at_the_end", "post.order", "", kAllFour, [](Program& p, PostContext&) { insert_on_path(p, {SwitchOn{Equipment::coolant, 0}}); }},
    {"arc_in_a_joint_move", "post.order", "", kAllFour,
     [](Program& p, PostContext& c) { insert_on_path(p, {SwitchOn{Equipment::arc, 1}, MoveJoint{c.cell.robot.home_rad, 0.3}, SwitchOff{Equipment::arc, 1}}); }},
    {"check_of_no_tool", "post.tool", "", kAllFour, [](Program& p, PostContext&) { insert_on_path(p, {SwitchOn{Equipment::tool_check, 77}}); }},
    {"check_at_a_rounded_corner", "post.order", "", kAllFour,
     [](Program& p, PostContext&) { insert_on_path(p, {MoveLinear{beside(p, {1, 1, 0}), 10, false, 1}, SwitchOn{Equipment::tool_check, 1}}); }},
    {"no_pulses", "post.missing_value", "controller.inform.pulses_per_degree", {Language::inform},
     [](Program&, PostContext& c) { c.cell.controller.pulses_per_degree.reset(); }},
    {"zero_pulses", "post.missing_value", "pulses_per_degree[2]", {Language::inform},
     [](Program&, PostContext& c) { (*c.cell.controller.pulses_per_degree)[2] = 0; }},
    {"no_speed_unit", "post.missing_value", "controller.inform.speed_unit", {Language::inform},
     [](Program&, PostContext& c) { c.cell.controller.speed_unit.reset(); }},
    {"no_orientation", "post.missing_value", "controller.beckhoff.orientation", {Language::beckhoff},
     [](Program&, PostContext& c) { c.cell.controller.orientation.reset(); }},
    {"no_kinematic_id", "post.missing_value", "controller.beckhoff.kinematic_id", {Language::beckhoff},
     [](Program&, PostContext& c) { c.cell.controller.kinematic_id.reset(); }},
    {"no_joint_speed", "post.missing_value", "robot.joints", {Language::beckhoff},
     [](Program&, PostContext& c) { c.cell.robot.joints[3].speed_rad_s = 0; }},
    {"no_m_function", "post.missing_value", "controller.beckhoff.output.9", {Language::beckhoff},
     [](Program& p, PostContext&) { p.instructions.insert(p.instructions.begin() + 3, SetOutput{9, true}); }},
    {"no_spindle_output", "post.missing_value", "spindle.output", {Language::krl, Language::inform},
     [](Program&, PostContext& c) { c.cell.tools[0].spindle.output = 0; }},
    {"no_spindle_analog", "post.missing_value", "spindle.analog", {Language::krl, Language::inform},
     [](Program&, PostContext& c) { c.cell.tools[0].spindle.analog = 0; }},
    {"long_name", "post.name", "", {Language::krl, Language::inform, Language::beckhoff}, [](Program& p, PostContext&) { p.name = std::string(80, 'A'); }},
    {"odd_name", "post.name", "", kAll, [](Program& p, PostContext&) { p.name = "PART-1"; }},
    {"digit_name", "post.name", "", kAll, [](Program& p, PostContext&) { p.name = "1PART"; }},
    {"old_inform_name", "post.name", "", {Language::inform},
     [](Program& p, PostContext& c) { p.name = "PARTNUMBER", c.cell.controller.options["inform.name_length"] = "8"; }},
    {"umlaut", "post.not_ascii", "", kAll, [](Program& p, PostContext&) { p.header.push_back("Gr\xc3\xb6\xc3\x9f" "e"); }},
    {"umlaut_in_comment", "post.not_ascii", "", kAll, [](Program& p, PostContext&) { p.instructions.insert(p.instructions.begin() + 3, Comment{"\xe4"}); }},
    {"line_end_in_comment", "post.not_ascii", "", kAll,
     [](Program& p, PostContext&) { p.instructions.insert(p.instructions.begin() + 3, Comment{"a\r\nPTP {A1 90}"}); }},
    {"spindle_of_a_tool_not_yet_moved", "post.order", "", {Language::inform},
     [](Program& p, PostContext& c) {
       p.instructions.insert(p.instructions.begin() + 3, {Instruction{SetTool{3, c.cell.tools[1].T_flange_tool}}, Instruction{SpindleOff{}}});
     }},
    {"tool_change_with_the_spindle_on", "post.order", "", kAll,
     [](Program& p, PostContext& c) {
       p.instructions.insert(p.instructions.begin() + 3, {Instruction{SpindleOn{5000}}, Instruction{SetTool{3, c.cell.tools[1].T_flange_tool}}});
     }},
    {"no_home", "post.order", "instruction", kAll, [](Program& p, PostContext&) { p.instructions.erase(p.instructions.begin() + 2, p.instructions.begin() + 4); }},
    {"no_tool", "post.order", "instruction 2", kAll, [](Program& p, PostContext&) { p.instructions.erase(p.instructions.begin()); }},
    {"no_frame", "post.order", "", kAll, [](Program& p, PostContext&) { p.instructions.erase(p.instructions.begin() + 1); }},
    {"spindle_left_on", "post.order", "", kAll, [](Program& p, PostContext&) { p.instructions.emplace_back(SpindleOn{1000}); }},
    {"nothing_moves", "post.order", "", kAll, [](Program& p, PostContext&) { p.instructions.resize(2); }},
    {"not_a_number", "post.not_finite", "", kAll, [](Program& p, PostContext&) { first<MoveLinear>(p).T_base_tool.p_mm.x() = std::numeric_limits<double>::quiet_NaN(); }},
    {"no_unit_quaternion", "post.not_finite", "", kAll, [](Program& p, PostContext&) { first<MoveLinear>(p).T_base_tool.q.coeffs() *= 1.1; }},
    {"joint_not_a_number", "post.not_finite", "", kAll, [](Program& p, PostContext&) { first<MoveJoint>(p).q_rad[3] = std::numeric_limits<double>::infinity(); }},
    {"joint_beyond_limit", "post.joint_limit", "", kAll, [](Program& p, PostContext&) { first<MoveJoint>(p).q_rad[4] = 2.5; }},
    {"no_speed", "post.speed", "", kAll, [](Program& p, PostContext&) { first<MoveLinear>(p).speed_mm_s = 0; }},
    {"negative_speed", "post.speed", "", kAll, [](Program& p, PostContext&) { first<MoveLinear>(p).speed_mm_s = -5; }},
    {"far_too_fast", "post.speed", "", kAll, [](Program& p, PostContext&) { first<MoveLinear>(p).speed_mm_s = 5000; }},
    {"joint_speed_zero", "post.joint_speed", "", kAll, [](Program& p, PostContext&) { first<MoveJoint>(p).speed_ratio = 0; }},
    {"joint_speed_above_all", "post.joint_speed", "", kAll, [](Program& p, PostContext&) { first<MoveJoint>(p).speed_ratio = 1.2; }},
    {"spindle_too_fast", "post.spindle", "", kAll, [](Program& p, PostContext&) { first<SpindleOn>(p).rpm = 99000; }},
    {"output_of_the_spindle", "post.output", "", kAll, [](Program& p, PostContext&) { p.instructions.insert(p.instructions.begin() + 3, SetOutput{5, true}); }},
    {"output_zero", "post.output", "", kAll, [](Program& p, PostContext&) { p.instructions.insert(p.instructions.begin() + 3, SetOutput{0, true}); }},
    {"long_wait", "post.wait", "", kAll, [](Program& p, PostContext&) { p.instructions.insert(p.instructions.begin() + 3, Wait{5000}); }},
    {"unknown_tool", "post.tool", "", kAll, [](Program& p, PostContext&) { first<SetTool>(p).number = 8; }},
    {"another_calibration", "post.tool", "", kAll, [](Program&, PostContext& c) { c.cell.tools[0].T_flange_tool.p_mm.z() += 0.01; }},
    {"krl_tool_number", "post.tool", "tools[cone-90].number", {Language::krl},
     [](Program& p, PostContext& c) { c.cell.tools[0].number = 17, first<SetTool>(p).number = 17; }},
    {"option_no_number", "post.option", "controller.krl.max_lines", {Language::krl}, [](Program&, PostContext& c) { c.cell.controller.options["krl.max_lines"] = "many"; }},
    {"krl_unknown_option", "post.option", "controller.krl.verson", {Language::krl}, [](Program&, PostContext& c) { c.cell.controller.options["krl.verson"] = "KRC2"; }},
    {"inform_unknown_option", "post.option", "controller.inform.levels", {Language::inform}, [](Program&, PostContext& c) { c.cell.controller.options["inform.levels"] = "1"; }},
    {"beckhoff_unknown_option", "post.option", "controller.beckhoff.mode", {Language::beckhoff}, [](Program&, PostContext& c) { c.cell.controller.options["beckhoff.mode"] = "0"; }},
    {"krc2_spline", "post.option", "controller.krl.motion", {Language::krl},
     [](Program&, PostContext& c) { c.cell.controller.options["krl.version"] = "KRC2", c.cell.controller.options["krl.motion"] = "spline"; }},
    {"krl_version", "post.option", "controller.krl.version", {Language::krl}, [](Program&, PostContext& c) { c.cell.controller.options["krl.version"] = "KRC9"; }},
    {"falling_levels", "post.option", "controller.inform.position_levels", {Language::inform},
     [](Program&, PostContext& c) { c.cell.controller.options["inform.position_levels"] = "5 1"; }},
    {"levels_no_number", "post.option", "controller.inform.position_levels", {Language::inform},
     [](Program&, PostContext& c) { c.cell.controller.options["inform.position_levels"] = "1 x"; }},
    {"option_flip", "post.option", "controller.inform.flip", {Language::inform}, [](Program&, PostContext& c) { c.cell.controller.options["inform.flip"] = "maybe"; }},
    {"option_m_functions", "post.option", "controller.beckhoff.output.7", {Language::beckhoff},
     [](Program& p, PostContext& c) {
       c.cell.controller.options["beckhoff.output.7"] = "3 5";
       p.instructions.insert(p.instructions.begin() + 3, SetOutput{7, true});
     }},
    {"no_date", "post.date", "", {Language::inform}, [](Program&, PostContext& c) { c.date = "yesterday"; }},
    {"two_user_frames", "post.frames", "", {Language::inform},
     [](Program& p, PostContext& c) {
       c.cell.controller.options["inform.user_frame"] = "2";
       p.instructions.insert(p.instructions.begin() + 3, SetFrame{{Eigen::Quaterniond::Identity(), Vec3(1, 2, 3)}});
     }},
    {"arc_after_joint_move", "post.arc", "", kAll,
     [](Program& p, PostContext&) {
       const auto T = first<MoveLinear>(p).T_base_tool;
       p.instructions.insert(p.instructions.begin() + 3, MoveCircular{T, T, 10, true, 0});
     }},
    {"arc_in_no_plane", "post.arc_plane", "", {Language::beckhoff},
     [](Program& p, PostContext&) {
       for (std::size_t i = 0; i < p.instructions.size(); ++i)
         if (auto* m = std::get_if<MoveLinear>(&p.instructions[i])) {
           m->is_exact = true;
           auto via = m->T_base_tool, end = m->T_base_tool;
           via.p_mm += Vec3(10, 3, 2), end.p_mm += Vec3(20, -1, 7);
           p.instructions.insert(p.instructions.begin() + static_cast<long>(i) + 1, MoveCircular{via, end, 10, true, 0});
           return;
         }
     }},
};

TEST(PostRefusals, every_case_is_refused_by_its_code) {
  for (const Case& k : kCases) {
    for (Language language : k.languages) {
      PostContext context = post_context();
      Program p = random_program(5, mix_for(*find_post(language), {.sections = 1, .points = 5, .has_arcs = false, .has_events = false, .has_two_tools = false, .has_new_frames = false, .has_equipment = false, .has_splines = false}));
      k.spoil(p, context);
      const auto text = find_post(language)->write(p, context);
      ASSERT_FALSE(text) << k.name << " " << name_of(language) << "\n" << text->files[0].bytes;
      bool has_code = false;
      for (const Refusal& r : text.error()) {
        has_code |= r.code == k.code && r.where.find(k.where) != std::string::npos;
        EXPECT_EQ(r.stage, "post");
        EXPECT_FALSE(r.message.empty());
      }
      EXPECT_TRUE(has_code) << k.name << " " << name_of(language) << "\n" << text_of(text.error());
    }
  }
}

TEST(PostRefusals, a_wait_in_a_rounded_corner) {
  PostContext context = post_context();
  Program p = random_program(5, {.sections = 1, .points = 1, .has_arcs = false, .has_events = false});
  for (std::size_t i = 0; i < p.instructions.size(); ++i)
    if (auto* m = std::get_if<MoveLinear>(&p.instructions[i])) {
      m->is_exact = false, m->blend_mm = 1;
      p.instructions.insert(p.instructions.begin() + static_cast<long>(i) + 1, Wait{1});
      break;
    }
  for (const Post& post : posts()) {
    const auto text = post.write(p, context);
    ASSERT_FALSE(text);
    EXPECT_EQ(text.error().front().code, "post.wait");
  }
}

TEST(PostRefusals, a_job_that_cannot_be_cut) {
  const PostContext context = post_context();
  Program p = random_program(5, {.sections = 1, .points = 1, .has_arcs = false, .has_events = false});
  std::size_t at = 0;
  while (!std::holds_alternative<MoveLinear>(p.instructions[at])) ++at;
  const Instruction line = p.instructions[at];
  p.instructions.insert(p.instructions.begin() + static_cast<long>(at), 100001, line);
  const auto text = find_post(Language::inform)->write(p, context);
  ASSERT_FALSE(text);
  EXPECT_EQ(text.error().front().code, "post.too_long");
}

TEST(PostRefusals, a_page_name_that_cannot_be_made) {
  PostContext context = post_context();
  context.cell.controller.options["inform.max_lines"] = "50";
  context.cell.controller.options["inform.name_length"] = "8";
  Program p = random_program(5, {.sections = 20});
  p.name = "RING_001";
  const auto text = find_post(Language::inform)->write(p, context);
  ASSERT_FALSE(text);
  EXPECT_EQ(text.error().front().code, "post.name");
}

TEST(PostNames, modules_of_long_names_stay_short_and_apart) {
  PostContext context = post_context();
  context.cell.controller.options["krl.max_lines"] = "50";
  std::vector<std::string> seen;
  for (const char* name : {"A_NAME_OF_24_CHARACTERS_", "A_NAME_OF_24_CHARACTERSA"}) {
    Program p = random_program(5, {.sections = 20});
    p.name = name;
    const auto text = find_post(Language::krl)->write(p, context);
    ASSERT_TRUE(text) << text_of(text.error());
    EXPECT_GT(text->files.size(), 12u);
    for (const ProgramFile& f : text->files) {
      EXPECT_LE(f.name.size(), 28u) << f.name;
      EXPECT_EQ(std::count(seen.begin(), seen.end(), f.name), 0) << f.name;
      seen.push_back(f.name);
    }
    const auto back = find_post(Language::krl)->read(*text, context);
    ASSERT_TRUE(back) << text_of(back.error());
    EXPECT_EQ(difference(p, *back, tolerance_of(*find_post(Language::krl), context), false), "");
  }
}

}  // namespace
}  // namespace asbuilt
