// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/program/program.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/hash.hpp"
#include "planner/base/number.hpp"

namespace asbuilt {

namespace {

/// ZYX angles (a, b, c) of a rotation, rad; b in [-90, 90] degrees.
Vec3 zyx_of(const Mat3& r) {
  const double b = std::atan2(-r(2, 0), std::hypot(r(0, 0), r(1, 0)));
  if (std::hypot(r(0, 0), r(1, 0)) < 1e-9) return {std::atan2(-r(0, 1), r(1, 1)), b, 0.0};
  return {std::atan2(r(1, 0), r(0, 0)), b, std::atan2(r(2, 1), r(2, 2))};
}

std::string ascii(const std::string& text) {
  std::string out;
  for (char c : text) out += static_cast<unsigned char>(c) >= 0x20 && static_cast<unsigned char>(c) < 0x7F ? c : '?';
  return out;
}

template <class A, class B>
std::string pose_text(const Pose<A, B>& T) {
  const Vec3 z = zyx_of(T.rotation());
  std::string s;
  for (int i = 0; i < 3; ++i) s += (i ? " " : "") + fixed_number(T.p_mm[i], 3);
  s += " mm, ZYX";
  for (int i = 0; i < 3; ++i) s += " " + fixed_number(deg_from_rad(z[i]), 4);
  return s + " deg";
}

void write_header(Program& out, const Job& job, const Pose<frame::Base, frame::Work>& T_base_work, const ToolPath& path,
                  const std::vector<const ToolSpec*>& tools) {
  const auto line = [&](const std::string& text) { out.header.push_back(ascii(text)); };
  line("item " + job.item_id + " of batch " + job.batch_id);
  line("part " + job.part.id + ", scanned " + job.taken);
  line("calibration of " + job.calibration_created + ", valid " + std::to_string(job.calibration_valid_days) + " days");
  for (const InputFile& f : job.inputs) line("input " + f.sha256.substr(0, 12) + " " + f.path);
  for (const ToolSpec* t : tools) line("tool " + std::to_string(t->number) + " " + t->id + ": " + pose_text(t->T_flange_tool));
  line("frame part: " + pose_text(T_base_work));
  double least = 1;
  std::size_t count = 0;
  for (std::size_t k = 0; k < path.edge_passes_count.size(); ++k) {
    if (path.edge_passes_count[k] == 0) continue;
    ++count;
    if (k < path.edge_share_ratio.size()) least = std::min(least, path.edge_share_ratio[k]);
  }
  line("gate: " + std::to_string(count) + " edges, least expected share in tolerance " + fixed_number(100 * least, 1) + " %");
  for (const Override& o : job.overrides)
    if (!job.taken.empty() && job.taken <= o.expires) line("override: edge " + o.edge + " by " + o.name + " until " + o.expires + ": " + o.reason);
  line("not run on a controller");
}

const char* const kReserved[] = {"def", "end", "home", "main", "bas", "cell", "for", "if", "loop", "while", "switch", "case", "repeat",
                                 "until", "wait", "halt", "goto", "return", "exit", "decl", "ext", "global", "interrupt", "ptp", "lin",
                                 "circ", "spline", "tool", "base", "frame", "pos", "axis", "int", "real", "bool", "char", "enum", "struc"};

class Writer {
 public:
  Writer(const ProgramRecipe& recipe, const Job& job, const ToolPath& path) : recipe_(recipe), job_(job), path_(path) {}

  void home() { joint(job_.cell.robot.home_rad, 0); }

  void segment(const MotionSegment& s) {
    const CutPass* pass = s.pass >= 0 ? &path_.passes[static_cast<std::size_t>(s.pass)] : nullptr;
    switch (s.kind) {
      case SegmentKind::transfer:
        spindle_off();
        for (std::size_t i = 1; i < s.q_rad.size(); ++i) joint(s.q_rad[i], s.speed_ratio);
        break;
      case SegmentKind::approach: {
        must(pass != nullptr, "an approach without a pass");
        comment(*pass);
        spindle_on(*pass);
        rapid(s, *pass);
        break;
      }
      case SegmentKind::cut:
        must(pass != nullptr, "a cut without a pass");
        spindle_on(*pass);
        cut(s, *pass);
        break;
      case SegmentKind::retract:
        must(pass != nullptr, "a retract without a pass");
        rapid(s, *pass);
        spindle_off();
        break;
    }
  }

  void finish() {
    spindle_off();
    if (last_q_ != job_.cell.robot.home_rad) joint(job_.cell.robot.home_rad, 0);
  }

  Program out;

 private:
  const ProgramRecipe& recipe_;
  const Job& job_;
  const ToolPath& path_;
  bool is_spinning_ = false;
  JointVector last_q_{};
  double slow_ratio_ = 0.2;

  void joint(const JointVector& q, double ratio) {
    MoveJoint m;
    m.q_rad = q, m.speed_ratio = ratio > 0 ? std::max(0.01, std::floor(ratio * 100 + 1e-9) / 100) : slow_ratio_;
    out.instructions.push_back(m);
    last_q_ = q;
  }
  void comment(const CutPass& p) {
    std::string text = p.feature + " pass " + std::to_string(p.pass) + "/" + std::to_string(p.passes) + " " + std::to_string(p.edges.size()) +
                       (p.edges.size() == 1 ? " edge" : " edges");
    out.instructions.push_back(Comment{ascii(text.substr(0, 32))});
  }
  void spindle_on(const CutPass& p) {
    if (is_spinning_) return;
    const Recipe* r = job_.recipe(p.recipe);
    out.instructions.push_back(SpindleOn{r->spindle_rpm});
    if (recipe_.spindle_settle_s > 0) out.instructions.push_back(Wait{recipe_.spindle_settle_s});
    is_spinning_ = true;
  }
  void spindle_off() {
    if (is_spinning_) out.instructions.push_back(SpindleOff{});
    is_spinning_ = false;
  }
  void rapid(const MotionSegment& s, const CutPass& p) {
    const double least = std::ceil(job_.recipe(p.recipe)->feed_max_mm_s * recipe_.rapid_over_feed_ratio * 10 - 1e-6) / 10;
    for (std::size_t i = 1; i < s.T_base_tool.size(); ++i) {
      MoveLinear m;
      m.T_base_tool = s.T_base_tool[i];
      m.speed_mm_s = rounded(std::max(least, i < s.speed_mm_s.size() ? s.speed_mm_s[i] : 0.0), 1);
      out.instructions.push_back(m);
    }
    if (!s.q_rad.empty()) last_q_ = s.q_rad.back();
  }
  void cut(const MotionSegment& s, const CutPass& p) {
    const double chord = job_.recipe(p.recipe)->path_tolerance_mm;
    const std::size_t n = s.T_base_tool.size();
    must(s.speed_mm_s.size() == n, "speeds are not parallel to the points");
    for (std::size_t i = 1; i < n; ++i) {
      MoveLinear m;
      m.T_base_tool = s.T_base_tool[i];
      m.speed_mm_s = rounded(std::max(0.1, std::floor(s.speed_mm_s[i] * 10 + 1e-6) / 10), 1);
      if (i + 1 < n) {
        // within d of a corner that turns by delta a rounded path leaves it by at most (d / 2) sin(delta / 2)
        const Vec3 a = m.T_base_tool.p_mm - s.T_base_tool[i - 1].p_mm, b = s.T_base_tool[i + 1].p_mm - m.T_base_tool.p_mm;
        const double delta = std::atan2(a.cross(b).norm(), a.dot(b)), sine = std::sin(0.5 * delta);
        double d = std::min({recipe_.blend_max_mm, 0.4 * a.norm(), 0.4 * b.norm()});
        if (sine > 1e-9) d = std::min(d, chord / sine);
        if (d >= 0.1) m.is_exact = false, m.blend_mm = std::floor(d * 10 + 1e-9) / 10;
      }
      out.instructions.push_back(m);
    }
    if (!s.q_rad.empty()) last_q_ = s.q_rad.back();
  }
};

}  // namespace

std::string program_name(const std::string& item_id) {
  std::string name;
  for (char c : item_id) {
    const bool is_letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'), is_digit = c >= '0' && c <= '9';
    name += is_letter ? static_cast<char>(c | 0x20) : is_digit ? c : '_';
  }
  if (name.empty() || name[0] < 'a') name = "p" + name;
  const bool is_reserved = std::find(std::begin(kReserved), std::end(kReserved), name) != std::end(kReserved);
  if (name == item_id && name.size() <= 24 && !is_reserved) return name;
  return name.substr(0, 17) + "_" + sha256_hex(item_id).substr(0, 6);
}

Pose<frame::Base, frame::Work> printed_frame(const Pose<frame::Base, frame::Part>& T) {
  const Vec3 z = zyx_of(T.rotation());
  const auto angle = [&](int i) { return rad_from_deg(rounded(deg_from_rad(z[i]), 4)); };
  return {quat_from_zyx(angle(0), angle(1), angle(2)), Vec3(rounded(T.p_mm.x(), 3), rounded(T.p_mm.y(), 3), rounded(T.p_mm.z(), 3))};
}

Result<Done<Program>> plan_program(const ProgramRecipe& recipe, const Job& job, const Location& location, const ToolPath& path,
                                   const Motion& motion) {
  if (motion.segments.empty() || path.passes.empty())
    return refuse({.code = "path.no_motion", .where = "item " + job.item_id, .message = "there is no motion to write a program from", .stage = "path"});
  std::vector<const ToolSpec*> tools;
  for (const CutPass& p : path.passes) {
    const ToolSpec* t = job.tool(p.tool);
    if (t == nullptr || job.recipe(p.recipe) == nullptr)
      return refuse({.code = "path.tool_does_not_fit",
                     .where = "feature " + p.feature,
                     .message = "tool " + p.tool + " or recipe " + p.recipe + " is not in the cell and the batch",
                     .stage = "path"});
    if (std::find(tools.begin(), tools.end(), t) == tools.end()) tools.push_back(t);
  }
  if (tools.size() != 1)
    return refuse({.code = "path.one_tool",
                   .where = "item " + job.item_id,
                   .message = "the features ask for " + std::to_string(tools.size()) + " tools; a program carries one: make an item for each",
                   .measured = static_cast<double>(tools.size()),
                   .limit = 1,
                   .unit = "count",
                   .stage = "path"});
  Done<Program> done;
  Writer w(recipe, job, path);
  w.out.name = program_name(job.item_id);
  const Pose<frame::Base, frame::Work> T_base_work = printed_frame(location.T_base_part);
  write_header(w.out, job, T_base_work, path, tools);
  w.out.instructions.push_back(SetTool{tools.front()->number, tools.front()->T_flange_tool});
  w.out.instructions.push_back(SetFrame{T_base_work});
  w.home();
  for (const MotionSegment& s : motion.segments) w.segment(s);
  w.finish();
  done.artefact = std::move(w.out);
  return done;
}

}  // namespace asbuilt
