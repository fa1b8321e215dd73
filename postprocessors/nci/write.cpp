// SPDX-License-Identifier: GPL-3.0-or-later
// Neutral program -> Beckhoff TwinCAT NC I (TF5100, classic): one .nc file. Facts and their confidence are in dialect.md. The PLC
// switches the kinematic transformation by two M functions; points are in base, the tool's angles in Q1, Q2, Q3.
#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "planner/base/number.hpp"
#include "postprocessors/nci/nci.hpp"
#include "postprocessors/writing.hpp"

namespace asbuilt::nci {
namespace {

using namespace writing;

constexpr int kMm = 3, kDeg = 4;
using Angles = std::array<double, 3>;  // Q1, Q2, Q3 in degrees

struct Machine {
  BeckhoffOrientation orientation = BeckhoffOrientation::cba;
  std::array<int, 2> kinematics{};  // M functions: transformation on, off
  std::map<std::string, std::array<int, 2>> codes;
  bool is_wrap_positive = false;    // the controller's own angles lie in (-180, 180]
  double slowest_deg_s = 0;
};

/// The principal angles of a rotation, printed: cba R = Rz(Q1) Ry(Q2) Rx(Q3); ypr R = Rz(Q3) Ry(-Q2) Rx(Q1); euler R = Rz(Q3) Ry(Q2) Rz(Q1).
Angles angles_of(const Mat3& R, BeckhoffOrientation mode) {
  Angles q;
  if (mode == BeckhoffOrientation::euler) {
    const double sin_b = std::hypot(R(0, 2), R(1, 2)), b = deg_from_rad(std::atan2(sin_b, R(2, 2)));
    const bool is_pole = sin_b < 1e-9;
    const double c = is_pole ? 0.0 : rounded(deg_from_rad(std::atan2(R(1, 2), R(0, 2))), kDeg);
    const double c_exact = is_pole ? 0.0 : deg_from_rad(std::atan2(R(1, 2), R(0, 2)));
    double a = deg_from_rad(is_pole ? std::atan2(R(1, 0), R(1, 1)) : std::atan2(R(2, 1), -R(2, 0)));
    a += (c_exact - c) * std::cos(rad_from_deg(b));  // what rounding Q3 turns about the tool is taken back by Q1
    q = {rounded(a, kDeg), rounded(b, kDeg), c};
  } else {
    const auto zyx = zyx_angles(R);
    const auto p = round_zyx({deg_from_rad(zyx[0]), deg_from_rad(zyx[1]), deg_from_rad(zyx[2])}, kDeg);
    q = mode == BeckhoffOrientation::cba ? Angles{p[0], p[1], p[2]} : Angles{p[2], rounded(-p[1], kDeg), p[0]};
  }
  for (double& v : q)
    if (v <= -180.0) v = 180.0;
  return q;
}

struct Writer {
  const Machine& machine;
  const PostContext& context;
  const std::string& name;
  Lines out{"\r\n"};
  int block = 0;
  const ToolSpec* tool = nullptr;
  bool is_cartesian = false;
  std::optional<Vec3> p_now;  // as printed
  std::optional<Angles> q_now;
  Refusals faults;
  std::size_t at = 0;

  void add(const std::string& text) { out.add("N" + std::to_string(block += 10) + " " + text); }
  void add_comment(std::string_view text) {
    for (std::string piece : pieces(text, 150)) {
      for (char& c : piece) c = c == '(' ? '[' : c == ')' ? ']' : c;
      piece.erase(piece.find_last_not_of(' ') + 1);
      out.add(piece.empty() ? "( )" : "(" + piece + ")");
    }
  }
  std::string where() const { return name + ": instruction " + std::to_string(at + 1); }
  void kinematics(bool on) {
    if (is_cartesian == on) return;
    add("M" + std::to_string(machine.kinematics[on ? 0 : 1]));
    is_cartesian = on;
    p_now.reset(), q_now.reset();
  }
  std::string axes(const std::array<double, 3>& xyz, const Angles& q, int decimals) const {
    std::string s;
    for (int i = 0; i < 3; ++i) s += std::string(" ") + "XYZ"[i] + fixed_number(xyz[static_cast<std::size_t>(i)], decimals);
    for (int i = 0; i < 3; ++i) s += " Q" + std::to_string(i + 1) + "=" + fixed_number(q[static_cast<std::size_t>(i)], kDeg);
    return s;
  }
  static std::string feed(double per_minute) { return " F" + fixed_number(per_minute, 2); }

  /// The words of a target; the angles run from block to block, one by one, so they must neither jump nor begin where the
  /// controller's own might have the other sign.
  std::string target(const Pose<frame::Base, frame::Tool>& T) {
    kinematics(true);
    const Angles q = angles_of(T.rotation(), machine.orientation);
    const double steep = machine.orientation == BeckhoffOrientation::euler ? std::min(std::abs(q[1]), 180 - std::abs(q[1])) : 90 - std::abs(q[1]);
    if (steep < 0.1)
      faults.push_back(fault("post.pole", where(), "the tool's angles have a pole here, where Q1 and Q3 cannot be told apart; turn the part or write for another controller", steep, 0.1, "deg"));
    double jump = 0, greatest = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      if (q_now) jump = std::max(jump, std::abs(q[i] - (*q_now)[i]));
      greatest = std::max(greatest, std::abs(q[i]));
    }
    if (jump > 90)
      faults.push_back(fault("post.angle_wrap", where(), "an angle jumps from one end of its range to the other and the tool would turn once about; turn the part or write for another controller", jump, 90, "deg"));
    if (!q_now && greatest > 179 && !machine.is_wrap_positive)
      faults.push_back(fault("post.missing_value", "cell.yaml: controller.nci.wrap",
                             "the first angle is near 180 degrees: \"positive\" says that the controller's own angles lie above -180 and up to 180, confirmed on it", greatest, 179, "deg"));
    q_now = q;
    std::array<double, 3> xyz;
    for (int i = 0; i < 3; ++i) xyz[static_cast<std::size_t>(i)] = rounded(T.p_mm[i], kMm);
    p_now = Vec3(xyz[0], xyz[1], xyz[2]);
    return axes(xyz, q, kMm);
  }

  void operator()(const SetTool& s) {
    const ToolSpec* t = find_tool(context, s.number);
    if (t == tool) return;
    tool = t;
    kinematics(false);
    add("T" + std::to_string(s.number) + " D" + std::to_string(s.number));
  }
  void operator()(const SetFrame&) {}  // points are in base
  void operator()(const MoveJoint& m) {
    kinematics(false);
    std::array<double, 3> xyz;
    Angles q;
    for (std::size_t i = 0; i < 3; ++i) xyz[i] = deg_from_rad(m.q_rad[i]), q[i] = deg_from_rad(m.q_rad[i + 3]);
    add("G01" + axes(xyz, q, kDeg) + feed(m.speed_ratio * machine.slowest_deg_s * 60));
  }
  void operator()(const MoveLinear& m) {
    const std::string words = target(m.T_base_tool);
    add("G01" + words + feed(m.speed_mm_s * 60));
  }
  void operator()(const MoveCircular& m) {
    if (!p_now) return faults.push_back(fault("post.arc", where(), "an arc must follow a straight move"));
    const Vec3 start = *p_now, via = m.T_base_via.p_mm;
    const std::string words = target(m.T_base_tool);
    const Vec3 stop = *p_now;
    const Vec3 normal = (via - start).cross(stop - via).normalized();
    int axis = 0;
    normal.cwiseAbs().maxCoeff(&axis);
    const double off_plane = std::max(std::abs(via[axis] - start[axis]), std::abs(stop[axis] - start[axis]));
    if (off_plane > 0.0021)
      return faults.push_back(fault("post.arc_plane", where(), "G02 and G03 lie in a plane of base and this arc does not; write it as straight moves", off_plane, 0.0021, "mm"));
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    const Vec2 p0(start[u], start[v]), a(via[u] - start[u], via[v] - start[v]), b(stop[u] - start[u], stop[v] - start[v]);
    const double det = 2 * (a.x() * b.y() - a.y() * b.x());
    Vec2 offset(b.y() * a.squaredNorm() - a.y() * b.squaredNorm(), a.x() * b.squaredNorm() - b.x() * a.squaredNorm());
    offset /= det;
    const Vec2 chord = b.normalized();
    offset += chord * (0.5 * b.norm() - chord.dot(offset));  // on the bisector of the printed ends
    std::array<double, 3> ijk{};
    ijk[static_cast<std::size_t>(u)] = offset.x(), ijk[static_cast<std::size_t>(v)] = offset.y();
    static constexpr const char* kPlanes[] = {"G19", "G18", "G17"};
    std::string s = std::string(kPlanes[axis]) + (det > 0 ? " G03" : " G02") + words;
    for (int i = 0; i < 3; ++i)
      if (i != axis) s += std::string(" ") + "IJK"[i] + fixed_number(ijk[static_cast<std::size_t>(i)], 5);
    add(s + feed(m.speed_mm_s * 60));
  }
  void operator()(const MoveSpline&) { faults.push_back(fault("post.spline", where(), "NC I has no splines; write straight moves")); }
  void operator()(const SpindleOn& s) { add("S" + fixed_number(s.rpm, 0) + " M03"); }
  void operator()(const SpindleOff&) { add("M05"); }
  void m_function(const std::string& key, bool on) {
    if (const auto it = machine.codes.find(key); it != machine.codes.end()) add("M" + std::to_string(it->second[on ? 0 : 1]));
  }
  void operator()(const SetOutput& s) { m_function("output." + std::to_string(s.output), s.value); }
  void operator()(const OutputOnPath&) {}  // refused before
  void operator()(const SwitchOn& s) { m_function(std::string(name_of(s.what)) + (s.data ? "." + std::to_string(s.data) : ""), true); }
  void operator()(const SwitchOff& s) { m_function(std::string(name_of(s.what)) + (s.data ? "." + std::to_string(s.data) : ""), false); }
  void operator()(const Wait& w) { add("G04 X" + fixed_number(w.time_s, 3)); }
  void operator()(const Comment& c) { add_comment(c.text); }
};

/// Two M functions (or one) under a key of the machine file; free are 6 to 159 but those that end programs.
void take_codes(Machine& machine, const PostContext& context, const std::string& name, std::size_t count, Refusals& faults) {
  const std::string key = "nci." + name;
  const auto text = option(context, key);
  if (!text)
    return faults.push_back(fault("post.missing_value", "cell.yaml: controller." + key, "NC I switches it by M functions of the PLC; give their numbers, on and off, as in \"50 51\""));
  const auto words = words_of(*text);
  std::array<int, 2> codes{};
  bool is_ok = words.size() == count;
  for (std::size_t i = 0; is_ok && i < count; ++i) {
    codes[i] = whole_number(words[i]).value_or(0);
    is_ok = codes[i] >= 6 && codes[i] <= 159 && codes[i] != 17 && codes[i] != 30;
  }
  if (!is_ok || (count == 2 && codes[0] == codes[1]))
    faults.push_back(fault("post.option", "cell.yaml: controller." + key, "\"" + *text + "\" is no " + (count == 2 ? "pair of M functions" : "M function") + " from 6 to 159 (17 and 30 end programs)"));
  machine.codes[name] = codes;
}

}  // namespace

Result<ProgramText> write(const Program& program, const PostContext& context) {
  Refusals faults = check(program, context, {.name_length = 60, .speed_min_mm_s = 0.01, .speed_max_mm_s = 3000, .wait_min_s = 0.001, .wait_max_s = 3600});
  check_options(context, "nci", {"orientation", "kinematics", "wrap", "output.", "coolant", "arc.", "weave.", "recording", "tool_check.", "path", "arcs", "receipt"}, faults);
  Machine machine;
  bool has_path = false;
  for (const Instruction& i : program.instructions) {
    has_path |= std::holds_alternative<MoveLinear>(i) || std::holds_alternative<MoveCircular>(i);
    if (const auto* s = std::get_if<SetTool>(&i); s && s->number < 1)
      faults.push_back(fault("post.tool", program.name, "Beckhoff tools are numbered from 1", s->number, 1));
    if (const auto* s = std::get_if<SetOutput>(&i); s && !machine.codes.count("output." + std::to_string(s->output)))
      take_codes(machine, context, "output." + std::to_string(s->output), 2, faults);
  }
  for (const auto& [what, data] : equipment_of(program))
    take_codes(machine, context, std::string(name_of(what)) + (data ? "." + std::to_string(data) : ""), what == Equipment::tool_check ? 1 : 2, faults);
  take_codes(machine, context, "kinematics", 2, faults);
  machine.kinematics = machine.codes["kinematics"];
  if (has_path) {
    const std::string mode = option(context, "nci.orientation").value_or("");
    if (mode.empty())
      faults.push_back(fault("post.missing_value", "cell.yaml: controller.nci.orientation", "which turns Q1, Q2, Q3 stand for is the transformation's; give cba, ypr or euler"));
    else if (mode != "cba" && mode != "ypr" && mode != "euler")
      faults.push_back(fault("post.option", "cell.yaml: controller.nci.orientation", "\"" + mode + "\" is none of cba, ypr, euler"));
    machine.orientation = mode == "ypr" ? BeckhoffOrientation::ypr : mode == "euler" ? BeckhoffOrientation::euler : BeckhoffOrientation::cba;
  }
  if (const auto wrap = option(context, "nci.wrap")) {
    machine.is_wrap_positive = *wrap == "positive";
    if (!machine.is_wrap_positive) faults.push_back(fault("post.option", "cell.yaml: controller.nci.wrap", "\"" + *wrap + "\" is not the one word known, positive"));
  }
  machine.slowest_deg_s = 1e300;
  for (const JointSpec& j : context.cell.robot.joints) machine.slowest_deg_s = std::min(machine.slowest_deg_s, deg_from_rad(j.speed_rad_s));
  if (!(machine.slowest_deg_s > 0))
    faults.push_back(fault("post.missing_value", "cell.yaml: robot.joints[].speed", "joint moves need the joints' greatest speeds"));
  if (!faults.empty()) return refuse_all(std::move(faults));

  Writer w{machine, context, program.name};
  for (const std::string& h : program.header) w.add_comment(h);
  w.add("G90 G71 G17");
  w.add("M" + std::to_string(machine.kinematics[1]));
  for (w.at = 0; w.at < program.instructions.size(); ++w.at) std::visit(w, program.instructions[w.at]);
  w.kinematics(false);
  w.add("M30");
  if (!w.faults.empty()) return refuse_all(std::move(w.faults));
  return ProgramText{Language::nci, {{program.name + ".nc", std::move(w.out.bytes)}}};
}

}  // namespace asbuilt::nci
