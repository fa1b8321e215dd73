// SPDX-License-Identifier: GPL-3.0-or-later
// Neutral program -> Beckhoff TwinCAT CNC (TF5200, ISG kernel): one .nc file. Facts and their confidence are in dialect.md.
// Joint moves are G01 with the transformation off, F in degrees per minute; path moves G01, G02, G03 in a #CS, mm with 3 and
// degrees with 4 decimals, every block with all six words and F.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "planner/base/number.hpp"
#include "postprocessors/beckhoff/beckhoff.hpp"
#include "postprocessors/writing.hpp"

namespace asbuilt::beckhoff {
namespace {

using namespace writing;

constexpr int kMm = 3, kDeg = 4;
using Angles = std::array<double, 3>;  // the words A, B, C in degrees

/// The two triples of words A, B, C that name a rotation, by the channel's convention (P-CHAN-00112).
///   cba   (2)  R = Rz(A) Ry(B) Rx(C)
///   ypr   (0)  R = Rz(C) Ry(-B) Rx(A)
///   euler (1)  R = Rz(C) Ry(B) Rz(A)
std::array<Angles, 2> words_of(const Mat3& R, BeckhoffOrientation mode) {
  if (mode == BeckhoffOrientation::euler) {
    const double sin_b = std::hypot(R(0, 2), R(1, 2));
    const double b = std::atan2(sin_b, R(2, 2));
    double c = 0, a = 0;
    if (sin_b < 1e-9) {
      a = std::atan2(R(1, 0), R(1, 1));  // C = 0; the whole turn goes to A (about -z where B = 180)
    } else {
      c = std::atan2(R(1, 2), R(0, 2));
      a = std::atan2(R(2, 1), -R(2, 0));
    }
    a = deg_from_rad(a), c = deg_from_rad(c);
    const double bd = deg_from_rad(b);
    return {Angles{a, bd, c}, Angles{a + 180, -bd, c + 180}};
  }
  const auto zyx = zyx_angles(R);
  const double z = deg_from_rad(zyx[0]), y = deg_from_rad(zyx[1]), x = deg_from_rad(zyx[2]);
  if (mode == BeckhoffOrientation::cba) return {Angles{z, y, x}, Angles{z + 180, 180 - y, x + 180}};
  return {Angles{x, -y, z}, Angles{x + 180, y - 180, z + 180}};
}

/// Of all triples that name the rotation, whole turns included, the one nearest to the words before: the angles run on without
/// a jump, since the controller interpolates them one by one.
Angles nearest_words(const Mat3& R, BeckhoffOrientation mode, const std::optional<Angles>& before) {
  const auto both = words_of(R, mode);
  Angles best = both[0];
  double best_sum = 1e300;
  for (const Angles& candidate : both) {
    Angles w = candidate;
    double sum = 0;
    for (int i = 0; i < 3; ++i) {
      w[i] -= 360.0 * std::round((w[i] - (before ? (*before)[i] : 0.0)) / 360.0);
      sum += std::abs(w[i] - (before ? (*before)[i] : 0.0));
    }
    if (sum < best_sum - 1e-6) best_sum = sum, best = w;
    if (!before) break;  // the first block takes the principal values
  }
  if (mode == BeckhoffOrientation::euler) {  // what rounding C turns about the tool axis is taken back by A
    const double c = rounded(best[2], kDeg);
    best[0] += (best[2] - c) * std::cos(rad_from_deg(best[1]));
    best = {rounded(best[0], kDeg), rounded(best[1], kDeg), c};
  } else if (mode == BeckhoffOrientation::cba) {
    best = round_zyx(best, kDeg);
  } else {
    const auto zyx = round_zyx({best[2], -best[1], best[0]}, kDeg);
    best = {zyx[2], rounded(-zyx[1], kDeg), zyx[0]};
  }
  for (double& v : best)
    if (!before && v <= -180.0) v = 180.0;
  return best;
}

/// Whether the words of the first block of a section are far from where the convention wraps or has its pole. The controller
/// starts from the angles of its own forward transformation: near 180 they might have the other sign, and the first block would
/// turn the tool once about.
bool is_far_from_wrap(const Angles& w, BeckhoffOrientation mode) {
  const bool is_middle = mode == BeckhoffOrientation::euler ? std::abs(w[1] - 90) <= 65 : std::abs(w[1]) <= 65;
  return is_middle && std::abs(w[0]) <= 120 && std::abs(w[2]) <= 120;
}

/// The 24 turns by right angles, those about x first: they keep the printed digits of a frame.
std::vector<Eigen::Quaterniond> right_angle_turns() {
  std::vector<Eigen::Quaterniond> out;
  const auto add = [&](const Eigen::Quaterniond& q) {
    for (const auto& known : out)
      if (std::abs(known.dot(q)) > 0.99) return;
    out.push_back(q);
  };
  const auto turn = [](int quarters, const Vec3& axis) { return Eigen::Quaterniond(Eigen::AngleAxisd(quarters * kPi / 2, axis)); };
  for (int x : {0, 2, 1, 3}) add(turn(x, Vec3::UnitX()));
  for (int z : {0, 1, 2, 3})
    for (int y : {0, 1, 2, 3})
      for (int x : {0, 1, 2, 3}) add(turn(z, Vec3::UnitZ()) * turn(y, Vec3::UnitY()) * turn(x, Vec3::UnitX()));
  return out;
}

std::string comment_text(std::string_view text) {
  std::string out(text);
  for (char& c : out) {  // characters outside the controller's set
    if (c == '{') c = '[';
    if (c == '}') c = ']';
    if (c == '|' || c == '\\') c = '/';
    if (c == '^') c = '*';
    if (c == '`') c = '\'';
  }
  return out;
}

struct Writer {
  const PostContext& context;
  BeckhoffOrientation orientation;
  double slowest_joint_deg_s;
  Lines out{"\r\n"};
  int block = 0;
  const ToolSpec* tool = nullptr;
  Pose<frame::Base, frame::Work> T_base_planned;  // of the last SetFrame
  std::string defined;                            // the last #CS DEF
  Pose<frame::Base, frame::Work> T_base_work;     // what it names: the planned frame, turned by right angles
  bool is_cartesian = false, is_contouring = false, is_hsc = false;
  double hsc_path_dev_mm = 0;
  std::optional<Angles> words;
  std::string contour;
  std::optional<Pose<frame::Work, frame::Tool>> T_now;  // as printed
  Refusals faults;
  std::size_t at = 0;
  std::string name;

  void add(const std::string& text) { out.add("N" + std::to_string(block += 10) + " " + text); }
  void add_comment(std::string_view text) {
    for (const std::string& piece : pieces(comment_text(text), 200)) {
      std::string line = "; " + piece;
      line.erase(line.find_last_not_of(' ') + 1);
      out.add(line);
    }
  }

  void to_joints() {
    if (is_contouring) add("G260");
    is_contouring = false;
    if (!is_cartesian) return;
    add("#CS OFF");
    add("#TRAFO OFF");
    is_cartesian = false;
    T_now.reset();
  }
  static std::string frame_text(const Printed& p) {
    std::string s;
    for (double v : p.xyz_mm) s += fixed_number(v, kMm) + ",";
    return s + fixed_number(p.abc_deg[2], kDeg) + "," + fixed_number(p.abc_deg[1], kDeg) + "," + fixed_number(p.abc_deg[0], kDeg);
  }
  /// Opens a section of path moves: the frame, turned so that the first block's angles are far from their wrap.
  void to_cartesian(const Pose<frame::Base, frame::Tool>& T_base_first) {
    if (is_cartesian) return;
    static const std::vector<Eigen::Quaterniond> turns = right_angle_turns();
    const auto printed_planned = frame_of(print_pose(T_base_planned.rotation(), T_base_planned.p_mm, kMm, kDeg));
    Printed best;
    for (const Eigen::Quaterniond& turn : turns) {
      best = print_pose((printed_planned.q * turn).toRotationMatrix(), printed_planned.p_mm, kMm, kDeg);
      T_base_work = frame_of(best);
      if (is_far_from_wrap(nearest_words((T_base_work.inverse() * T_base_first).rotation(), orientation, std::nullopt), orientation)) break;
    }
    const std::string definition = "#CS DEF [1][" + frame_text(best) + "]";
    if (definition != defined) add(defined = definition);
    add("#TRAFO ON");
    add("#CS ON [1]");
    is_cartesian = true;
    words.reset();
  }

  std::string contour_words(bool is_exact, double blend_mm) {
    const bool wanted = !is_exact && rounded(blend_mm, kMm) > 0;
    if (wanted) {
      const std::string d = fixed_number(blend_mm, kMm);
      const std::string mode = "#CONTOUR MODE [DIST PRE_DIST=" + d + " POST_DIST=" + d + "]";
      if (mode != contour) add(contour = mode);
    }
    const std::string s = wanted == is_contouring ? "" : wanted ? "G261 " : "G260 ";
    is_contouring = wanted;
    return s;
  }
  struct Target {
    std::array<double, 3> xyz_mm;
    Angles abc_deg;
  };
  Target target_of(const Pose<frame::Base, frame::Tool>& T_base_tool) {
    const auto T = T_base_work.inverse() * T_base_tool;
    Target t;
    for (int i = 0; i < 3; ++i) t.xyz_mm[i] = rounded(T.p_mm[i], kMm);
    t.abc_deg = nearest_words(T.rotation(), orientation, words);
    words = t.abc_deg;
    T_now = {T.q, Vec3(t.xyz_mm[0], t.xyz_mm[1], t.xyz_mm[2])};
    return t;
  }
  static std::string words_text(const Target& t) {
    std::string s = " X" + fixed_number(t.xyz_mm[0], kMm) + " Y" + fixed_number(t.xyz_mm[1], kMm) + " Z" + fixed_number(t.xyz_mm[2], kMm);
    return s + " A" + fixed_number(t.abc_deg[0], kDeg) + " B" + fixed_number(t.abc_deg[1], kDeg) + " C" + fixed_number(t.abc_deg[2], kDeg);
  }
  static std::string feed(double speed_mm_s) { return " F" + fixed_number(speed_mm_s * 60.0, 2); }

  void operator()(const SetTool& s) {
    const ToolSpec* t = find_tool(context, s.number);
    if (t == tool) return;
    tool = t;
    to_joints();
    add("T" + std::to_string(s.number) + " D" + std::to_string(s.number));
    tool_check(*t);
  }
  std::vector<int> tool_data;  // beckhoff.tool_data: the indices of the tool's kinematic parameters X Y Z, or X Y Z A B C
  /// The interpreter waits until the controller's tool data are what the plan was made with: 0.1 micrometres and 0.0001 degrees, to 0.01 of each.
  void tool_check(const ToolSpec& t) {
    const Printed p = print_pose(t.T_flange_tool.rotation(), t.T_flange_tool.p_mm, kMm, kDeg);
    for (std::size_t i = 0; i < tool_data.size(); ++i) {
      const long long v = std::llround((i < 3 ? p.xyz_mm[i] : p.abc_deg[i - 3]) * 1e4);
      add("#WAIT FOR ABS[V.G.WZ[" + std::to_string(t.number) + "].KIN_PARAM[" + std::to_string(tool_data[i]) + "]" + (v < 0 ? "+" : "-") + std::to_string(std::llabs(v)) + "] < 100");
    }
  }
  void operator()(const SetFrame& s) {
    if (s.T_base_work.p_mm == T_base_planned.p_mm && s.T_base_work.q.coeffs() == T_base_planned.q.coeffs()) return;
    to_joints();
    T_base_planned = s.T_base_work;
  }

  void operator()(const MoveJoint& m) {
    to_joints();
    static constexpr const char* kLetters[] = {" X", " Y", " Z", " A", " B", " C"};
    std::string s = "G01";
    for (int i = 0; i < 6; ++i) s += kLetters[i] + fixed_number(deg_from_rad(m.q_rad[i]), kDeg);
    add(s + " F" + fixed_number(m.speed_ratio * slowest_joint_deg_s * 60.0, 2));
  }
  void operator()(const MoveLinear& m) {
    to_cartesian(m.T_base_tool);
    const std::string c = contour_words(m.is_exact, m.blend_mm);
    add(c + "G01" + words_text(target_of(m.T_base_tool)) + feed(m.speed_mm_s));
  }
  void operator()(const MoveCircular& m) {
    to_cartesian(m.T_base_tool);
    const std::string where = name + ": instruction " + std::to_string(at + 1);
    if (!T_now) {
      faults.push_back(fault("post.arc", where, "an arc must follow a straight move"));
      return;
    }
    const Vec3 start = T_now->p_mm;
    const auto via = T_base_work.inverse() * m.T_base_via;
    const std::string c = contour_words(m.is_exact, m.blend_mm);
    const Target end = target_of(m.T_base_tool);
    const Vec3 stop = T_now->p_mm;
    // The plane of the arc must be parallel to one of the frame's planes: G17, G18, G19.
    const Vec3 normal = (via.p_mm - start).cross(stop - via.p_mm).normalized();
    int axis = 0;
    normal.cwiseAbs().maxCoeff(&axis);
    const double off_plane = std::max({std::abs(via.p_mm[axis] - start[axis]), std::abs(stop[axis] - start[axis])});
    if (off_plane > 0.0021) {
      faults.push_back(fault("post.arc_plane", where,
                             "G02 and G03 lie in a plane of the work frame and this arc does not; write it as straight moves or turn the frame",
                             off_plane, 0.0021, "mm"));
      return;
    }
    // Centre: on the bisector of the printed start and end, at the distance the three points ask for.
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;  // right-handed: (u, v, axis) = (X,Y,Z), (Y,Z,X), (Z,X,Y)
    const Vec2 p0(start[u], start[v]), p1(via.p_mm[u], via.p_mm[v]), p2(stop[u], stop[v]);
    const Vec2 a = p1 - p0, b = p2 - p0;
    const double det = 2 * (a.x() * b.y() - a.y() * b.x());
    Vec2 centre = p0 + Vec2(b.y() * a.squaredNorm() - a.y() * b.squaredNorm(), a.x() * b.squaredNorm() - b.x() * a.squaredNorm()) / det;
    const Vec2 chord = b.normalized(), middle = (p0 + p2) / 2;
    centre -= chord * chord.dot(centre - middle);
    const Vec2 offset = centre - p0;
    static constexpr const char* kPlanes[] = {"G19", "G18", "G17"};
    static constexpr const char* kCentre[] = {" I", " J", " K"};
    std::array<double, 3> ijk{};
    ijk[u] = offset.x(), ijk[v] = offset.y();
    std::string s = std::string(kPlanes[axis]) + " " + c + (det > 0 ? "G03" : "G02") + words_text(end);
    for (int i = 0; i < 3; ++i)
      if (i != axis) s += kCentre[i] + fixed_number(ijk[i], 5);
    add(s + feed(m.speed_mm_s));
  }
  void operator()(const SpindleOn& s) { add("S" + fixed_number(s.rpm, 0) + " M03"); }
  void operator()(const SpindleOff&) { add("M05"); }
  void operator()(const SetOutput& s) {
    const auto codes = m_functions("output." + std::to_string(s.output), 2, "a CNC program switches outputs by M functions; give the two of this output, on and off, as in \"50 51\"");
    if (codes) add("M" + std::to_string((*codes)[s.value ? 0 : 1]));
  }
  /// The M functions of the PLC under a key of the machine file; never guessed.
  std::optional<std::array<int, 2>> m_functions(const std::string& name, std::size_t count, const char* ask) {
    const std::string key = "beckhoff." + name;
    const auto text = option(context, key);
    if (!text) {
      faults.push_back(fault("post.missing_value", "cell.yaml: controller." + key, ask));
      return std::nullopt;
    }
    const auto words = writing::words_of(*text);
    std::array<int, 2> codes{};
    bool is_ok = words.size() == count;
    for (std::size_t i = 0; is_ok && i < count; ++i) {
      codes[i] = whole_number(words[i]).value_or(0);
      is_ok = (codes[i] >= 31 && codes[i] <= 999) || (name == "coolant" && codes[i] >= 7 && codes[i] <= 9);
    }
    if (!is_ok || (count == 2 && codes[0] == codes[1])) {
      faults.push_back(fault("post.option", "cell.yaml: controller." + key, "\"" + *text + "\" is no " + (count == 2 ? "pair of M functions" : "M function") + " from 31 to 999"));
      return std::nullopt;
    }
    return codes;
  }
  void equipment(Equipment what, int data, bool on) {
    const std::string name = std::string(name_of(what)) + (data ? "." + std::to_string(data) : "");
    const auto codes = m_functions(name, what == Equipment::tool_check ? 1 : 2, "give the M functions of the PLC for it, on and off, as in \"60 61\"");
    if (codes) add("M" + std::to_string((*codes)[on ? 0 : 1]));
  }
  void operator()(const SwitchOn& s) { equipment(s.what, s.data, true); }
  void operator()(const SwitchOff& s) { equipment(s.what, s.data, false); }
  void operator()(const OutputOnPath&) {}  // refused before
  /// Points of a spline: blocks inside #HSC, which leaves them by at most PATH_DEV. Nothing else may stand inside.
  void operator()(const MoveSpline& m) {
    if (!is_hsc) {
      to_cartesian(m.T_base_tool);
      if (is_contouring) add("G260");
      is_contouring = false;
      add("#HSC ON [BSPLINE PATH_DEV=" + fixed_number(hsc_path_dev_mm, kMm) + "]");
      is_hsc = true;
    }
    add("G01" + words_text(target_of(m.T_base_tool)) + feed(m.speed_mm_s));
  }
  void end_spline() {
    if (is_hsc) add("#HSC OFF");
    is_hsc = false;
  }
  void operator()(const Wait& w) { add("G04 X" + fixed_number(w.time_s, 3)); }
  void operator()(const Comment& c) { add_comment(c.text); }
};

}  // namespace

Result<ProgramText> write(const Program& program, const PostContext& context) {
  const ControllerSpec& c = context.cell.controller;
  Refusals faults = check(program, context, {.name_length = 60, .speed_min_mm_s = 0.01, .speed_max_mm_s = 3000, .wait_min_s = 0.001, .wait_max_s = 3600});
  check_options(context, "beckhoff", {"output.", "rapid_mm_s", "coolant", "arc.", "weave.", "recording", "tool_check.", "hsc_path_dev", "delivery", "path", "arcs", "receipt", "tool_data"}, faults);
  bool has_path = false, has_spline = false;
  for (const Instruction& i : program.instructions) {
    has_spline |= std::holds_alternative<MoveSpline>(i);
    has_path |= std::holds_alternative<MoveLinear>(i) || std::holds_alternative<MoveCircular>(i);
    if (const auto* s = std::get_if<SetTool>(&i); s && s->number < 1)
      faults.push_back(fault("post.tool", program.name, "Beckhoff tools are numbered from 1", s->number, 1));
  }
  if (has_path && !c.orientation)
    faults.push_back(fault("post.missing_value", "cell.yaml: controller.beckhoff.orientation",
                           "the words A, B, C mean different angles by channel parameter P-CHAN-00112; give cba (2), ypr (0) or euler (1)"));
  if (has_path && !c.kinematic_id)
    faults.push_back(fault("post.missing_value", "cell.yaml: controller.beckhoff.kinematic_id",
                           "#KIN ID chooses the robot's transformation; give the channel's number"));
  double hsc_path_dev_mm = 0;
  if (const auto text = option(context, "beckhoff.hsc_path_dev")) {
    const auto um = writing::words_of(*text);
    char* end = nullptr;
    hsc_path_dev_mm = um.size() == 1 ? std::strtod(um[0].c_str(), &end) : 0;
    if (!end || *end || !(hsc_path_dev_mm >= 0.001) || hsc_path_dev_mm > 1)
      faults.push_back(fault("post.option", "cell.yaml: controller.beckhoff.hsc_path_dev", "\"" + *text + "\" is no length from 0.001 to 1 mm", hsc_path_dev_mm, 1, "mm"));
  } else if (has_spline) {
    faults.push_back(fault("post.missing_value", "cell.yaml: controller.beckhoff.hsc_path_dev",
                           "#HSC is a licensed option; where it is there, give how far it may leave the points, mm"));
  }
  std::vector<int> tool_data;
  if (const auto text = option(context, "beckhoff.tool_data")) {
    for (const std::string& word : writing::words_of(*text)) tool_data.push_back(whole_number(word).value_or(-1));
    if ((tool_data.size() != 3 && tool_data.size() != 6) || std::any_of(tool_data.begin(), tool_data.end(), [](int i) { return i < 0 || i > 69; }))
      faults.push_back(fault("post.option", "cell.yaml: controller.beckhoff.tool_data", "\"" + *text + "\" are not three or six indices of V.G.WZ[n].KIN_PARAM, 0 to 69, of X Y Z (and A B C)", static_cast<double>(tool_data.size()), 6));
  }
  const std::string delivery = option(context, "beckhoff.delivery").value_or("main");
  const bool is_sub = delivery == "sub";
  if (!is_sub && delivery != "main") faults.push_back(fault("post.option", "cell.yaml: controller.beckhoff.delivery", "\"" + delivery + "\" is neither main nor sub"));
  double slowest = 1e300;
  for (const JointSpec& j : context.cell.robot.joints) slowest = std::min(slowest, deg_from_rad(j.speed_rad_s));
  if (!(slowest > 0))
    faults.push_back(fault("post.missing_value", "cell.yaml: robot.joints[].speed", "joint moves need the joints' greatest speeds"));
  if (!faults.empty()) return refuse_all(std::move(faults));

  Writer w{context, c.orientation.value_or(BeckhoffOrientation::cba), slowest};
  w.name = program.name;
  if (!is_sub) w.out.add("%" + program.name);
  for (const std::string& h : program.header) w.add_comment(h);
  w.add("G90 G71 G94 G17 G40 G53 G162");
  w.add("#CS OFF ALL");
  w.add("#TRAFO OFF");
  if (c.kinematic_id) w.add("#KIN ID [" + std::to_string(*c.kinematic_id) + "]");
  w.hsc_path_dev_mm = hsc_path_dev_mm;
  w.tool_data = tool_data;
  for (w.at = 0; w.at < program.instructions.size(); ++w.at) {
    if (!std::holds_alternative<MoveSpline>(program.instructions[w.at])) w.end_spline();
    std::visit(w, program.instructions[w.at]);
  }
  w.end_spline();
  w.to_joints();
  w.add(is_sub ? "M17" : "M30");
  if (!w.faults.empty()) return refuse_all(std::move(w.faults));
  return ProgramText{Language::beckhoff, {{program.name + ".nc", std::move(w.out.bytes)}}};
}

}  // namespace asbuilt::beckhoff
