// SPDX-License-Identifier: GPL-3.0-or-later
// The neutral program: what every dialect has to say, and what every reader gives back.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "planner/artefacts/motion.hpp"
#include "planner/base/frames.hpp"

namespace asbuilt {

struct SetTool {  // the active TCP from here on
  int number = 0;
  Pose<frame::Flange, frame::Tool> T_flange_tool;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("number", s.number), a("T_flange_tool", s.T_flange_tool);
  }
};
struct SetFrame {  // the frame the following Cartesian points are written in; the points below stay in base
  Pose<frame::Base, frame::Work> T_base_work;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("T_base_work", s.T_base_work);
  }
};
struct MoveJoint {  // synchronous joint motion, exact stop
  JointVector q_rad{};
  double speed_ratio = 0;  // 0..1 of the joints' limits
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("q", s.q_rad), a("speed_ratio", s.speed_ratio);
  }
};
struct MoveLinear {
  Pose<frame::Base, frame::Tool> T_base_tool;
  double speed_mm_s = 0;
  bool is_exact = true;     // false: the controller may round the corner within blend_mm
  double blend_mm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("T_base_tool", s.T_base_tool), a("speed", s.speed_mm_s), a("is_exact", s.is_exact), a("blend", s.blend_mm);
  }
};
struct MoveCircular {       // through via (a point ON the arc) to the end; below 180 degrees of arc
  Pose<frame::Base, frame::Tool> T_base_via, T_base_tool;
  double speed_mm_s = 0;
  bool is_exact = true;
  double blend_mm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("T_base_via", s.T_base_via), a("T_base_tool", s.T_base_tool), a("speed", s.speed_mm_s), a("is_exact", s.is_exact), a("blend", s.blend_mm);
  }
};
struct MoveSpline {         // one point of a smooth curve; neighbours in the list make one curve, which starts where the tool stands and ends exactly
  Pose<frame::Base, frame::Tool> T_base_tool;
  double speed_mm_s = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("T_base_tool", s.T_base_tool), a("speed", s.speed_mm_s);
  }
};
struct SpindleOn {
  double rpm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("rpm", s.rpm);
  }
};
struct SpindleOff {
  template <class S, class A>
  static void visit(S&, A&&) {}
};
struct SetOutput {
  int output = 0;
  bool value = false;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("output", s.output), a("value", s.value);
  }
};
struct OutputOnPath {  // an output that changes while the tool goes on, on the path motion that follows
  int output = 0;
  bool value = false;
  double path_mm = 0;  // above 0: behind the start of that motion; below 0: before its end; never 0 (that is SetOutput)
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("output", s.output), a("value", s.value), a("path", s.path_mm);
  }
};
enum class Equipment { coolant, arc, weave, recording, tool_check };  // what else a controller switches; arc and weave by a numbered set of data
inline std::string_view name_of(Equipment e) {
  switch (e) {
    case Equipment::coolant: return "coolant";
    case Equipment::arc: return "arc";
    case Equipment::weave: return "weave";
    case Equipment::recording: return "recording";
    default: return "tool_check";
  }
}
struct SwitchOn {
  Equipment what = Equipment::coolant;
  int data = 0;  // number of the data set on the controller: arc and weave from 1, tool_check the tool's number; 0 for the others
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("what", s.what), a("data", s.data);
  }
};
struct SwitchOff {  // a tool check ends by itself and is never switched off
  Equipment what = Equipment::coolant;
  int data = 0;  // as switched on
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("what", s.what), a("data", s.data);
  }
};
struct Wait {
  double time_s = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("time", s.time_s);
  }
};
struct Comment {
  std::string text;  // ASCII
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("text", s.text);
  }
};
using Instruction = std::variant<SetTool, SetFrame, MoveJoint, MoveLinear, MoveCircular, SpindleOn, SpindleOff, SetOutput, Wait, Comment,
                                 MoveSpline, OutputOnPath, SwitchOn, SwitchOff>;

struct Program {
  std::string name;                      // letters, digits, underscore; first a letter; at most 24 characters
  std::vector<std::string> header;       // provenance lines, ASCII: item, hashes, calibration, gate, overrides
  std::vector<Instruction> instructions; // starts with SetTool, SetFrame, then a MoveJoint to home; ends at home, spindle off
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("name", s.name), a("header", s.header), a("instructions", s.instructions);
  }
};

}  // namespace asbuilt
