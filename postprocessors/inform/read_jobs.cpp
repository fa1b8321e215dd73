// SPDX-License-Identifier: GPL-3.0-or-later
// The whitelist of dialect.md for what stands in a job before its instructions, and for UFRAME.CND and TOOL.CND.
#include "postprocessors/inform/read_jobs.hpp"

#include <cmath>
#include <cstdio>
#include <optional>

namespace asbuilt::inform {

using namespace reading;

std::string job_name(Scanner& s) {
  std::string out;
  const std::string_view rest = s.rest();
  while (out.size() < rest.size() && ((rest[out.size()] >= 'A' && rest[out.size()] <= 'Z') || (rest[out.size()] >= '0' && rest[out.size()] <= '9') ||
                                      rest[out.size()] == '_' || rest[out.size()] == '-'))
    out += rest[out.size()];
  if (out.empty() || out.size() > 32) s.unknown();
  s.expect(out);
  return out;
}

namespace {

bool ends_with(std::string_view name, std::string_view end) {
  if (name.size() < end.size()) return false;
  for (std::size_t i = 0; i < end.size(); ++i) {
    char c = name[name.size() - end.size() + i];
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
    if (c != end[i]) return false;
  }
  return true;
}

class Loader {
 public:
  explicit Loader(const PostContext& context) : context_(context) {}

  Jobs load_all(const ProgramText& text) {
    for (const ProgramFile& f : text.files)
      if (ends_with(f.name, ".CND")) load_frames(f);
    for (const ProgramFile& f : text.files) {
      if (ends_with(f.name, ".CND")) continue;
      if (!ends_with(f.name, ".JBI")) fail({&f.name, 0, {}}, "read.file", "an INFORM program consists of .JBI and .CND files");
      const std::string name = load(f);
      if (out_.first.empty()) out_.first = name;
    }
    if (out_.first.empty()) fail({}, "read.missing", "no .JBI file");
    return std::move(out_);
  }

 private:
  const PostContext& context_;
  Jobs out_;
  std::vector<bool> rconf_;  // the last flags above the positions

  void need_line_ends(const ProgramFile& f) {
    int number = 1;
    for (std::size_t i = 0; i < f.bytes.size(); ++i) {
      if (f.bytes[i] == '\n' && (i == 0 || f.bytes[i - 1] != '\r')) fail({&f.name, number, {}}, "read.line_end", "a line ends without CR LF");
      if (f.bytes[i] == '\r' && (i + 1 == f.bytes.size() || f.bytes[i + 1] != '\n')) fail({&f.name, number, {}}, "read.line_end", "a CR without LF");
      number += f.bytes[i] == '\n';
    }
    if (f.bytes.empty() || f.bytes.back() != '\n') fail({&f.name, number, {}}, "read.line_end", "the last line has no CR LF");
  }

  static std::array<double, 6> six(Scanner& s) {
    std::array<double, 6> v{};
    for (int i = 0; i < 6; ++i) {
      if (i) s.expect(",");
      v[i] = s.expect_number("a number");
    }
    s.expect_end();
    return v;
  }
  static Eigen::Quaterniond rotation(const std::array<double, 6>& v) { return rotation_zyx(v[5], v[4], v[3]); }

  void load_frames(const ProgramFile& f) {
    std::optional<int> number;  // of the frame
    int tool = -1;              // whose pose comes next
    bool is_tool_file = false;
    for (const Line& line : lines_of(f)) {
      Scanner s(line);
      if (s.at_end()) continue;
      if (s.accept("//TOOL")) {
        tool = s.expect_integer("the tool", 0, 63);
        s.expect_end();
        is_tool_file = true;
      } else if (is_tool_file && !s.accept("///NAME")) {  // X, Y, Z, Rx, Ry, Rz, then the load
        if (!s.number()) s.unknown();
        if (tool < 0) continue;
        check_tool(line, tool, six(line));
        tool = -1;
      } else if (is_tool_file) {
        continue;
      } else if (s.accept("//UFRAME")) {
        number = s.expect_integer("the user frame", 1, 63);
        s.expect_end();
      } else if (s.accept("///BUSER")) {
        if (!number) fail(line, "read.unknown", "///BUSER before //UFRAME");
        const auto v = six(s);
        if (!out_.user_frames.emplace(*number, Pose<frame::Base, frame::Work>(rotation(v), Vec3(v[0], v[1], v[2]))).second)
          fail(line, "read.name", "user frame " + std::to_string(*number) + " is given twice", *number);
      } else if (s.accept("///GROUP")) {  // the frame of another control group is another frame
        for (const char* t : {"1", ",", "0", ",", "0"}) s.expect(t);
        s.expect_end();
      } else if (s.accept("///TOOL")) {
        s.expect_integer("the tool", 0, 63), s.expect_end();
      } else if (!s.accept("///NAME")) {
        s.unknown();
      }
    }
  }

  static std::array<double, 6> six(const Line& line) {
    Scanner s(line);
    return six(s);
  }
  /// The controller's own tool data, where they are given: those of the cell, to 0.01 mm and 0.01 degrees.
  void check_tool(const Line& line, int number, const std::array<double, 6>& v) {
    for (const ToolSpec& t : context_.cell.tools) {
      if (t.number != number) continue;
      const double mm = (t.T_flange_tool.p_mm - Vec3(v[0], v[1], v[2])).cwiseAbs().maxCoeff();
      if (mm > 0.0101) fail(line, "read.tool_data", "tool " + std::to_string(number) + " of the controller is not the cell's: enter the calibrated one", mm, 0.01, "mm");
      const double deg = deg_from_rad(quat_log(t.T_flange_tool.q.conjugate() * rotation(v)).norm());
      if (deg > 0.0101) fail(line, "read.tool_data", "tool " + std::to_string(number) + " of the controller is turned against the cell's: enter the calibrated one", deg, 0.01, "deg");
    }
  }

  std::string load(const ProgramFile& f) {
    need_line_ends(f);
    const std::vector<Line> lines = lines_of(f);
    std::size_t i = 0;
    const auto next = [&]() -> const Line& {
      if (i >= lines.size()) fail({&f.name, static_cast<int>(lines.size()), {}}, "read.missing", "the job ends too early");
      return lines[i++];
    };
    const Line& head = next();
    if (head.text != "/JOB") fail(head, "read.missing", "a job begins with /JOB");
    Job job;
    {
      const Line& line = next();
      Scanner s(line);
      s.expect("//NAME");
      job.head = line;
      job.name = job_name(s);
      s.expect_end();
      if (f.name.size() != job.name.size() + 4 || !ends_with(f.name, job.name + ".JBI"))
        fail(line, "read.name", "the job is called " + job.name + " and its file " + f.name);
    }
    std::optional<int> count, tool, user;
    std::string type;
    bool is_rectan = false, has_rconf = false;
    bool in_positions = false, at_instructions = false;
    while (!at_instructions) {
      const Line& line = next();
      Scanner s(line);
      if (s.accept("///FOLDERNAME")) {
        if (s.name().empty()) s.unknown();
      } else if (!in_positions) {
        s.expect("//POS");
        in_positions = true;
      } else if (s.accept("///NPOS")) {
        if (count) s.unknown();
        count = s.expect_integer("the count", 0, 100000);
        for (int k = 0; k < 5; ++k) s.expect(","), s.expect_integer("the count of other positions", 0, 0);
      } else if (s.accept("///USER")) {
        user = s.expect_integer("the user frame", 1, 63);
      } else if (s.accept("///TOOL")) {
        tool = s.expect_integer("the tool", 0, 63);
      } else if (s.accept("///POSTYPE")) {
        type = s.name();
        if (type != "PULSE" && type != "BASE" && type != "ROBOT" && type != "USER")
          fail(line, "read.unknown", "positions of type " + type + " are not read");
        is_rectan = has_rconf = false;
      } else if (s.accept("///PULSE")) {
        if (type != "PULSE") s.unknown();
      } else if (s.accept("///RECTAN")) {
        if (type == "PULSE" || type.empty()) s.unknown();
        is_rectan = true;
      } else if (s.accept("///RCONF")) {
        if (!is_rectan) s.unknown();
        int n = 0;
        rconf_.clear();
        do rconf_.push_back(s.expect_integer("an RCONF flag", 0, 1) == 1), ++n;
        while (s.accept(","));
        if (n != 24 && (n < 6 || n > 8)) fail(line, "read.range", "RCONF has 24 flags, or 6 to 8 on older controllers", n, 24);
        has_rconf = true;
      } else if (s.accept("//INST")) {
        at_instructions = true;
      } else {
        position(s, job, count, tool, user, type, is_rectan, has_rconf);
      }
      s.expect_end();
    }
    if (!count) fail(job.head, "read.missing", "///NPOS is missing");
    if (*count != static_cast<int>(job.positions.size()))
      fail(job.head, "read.count", "///NPOS names " + std::to_string(*count) + " positions, there are " + std::to_string(job.positions.size()),
           static_cast<double>(job.positions.size()), *count);
    instruction_head(next, job);
    bool has_end = false;
    while (i < lines.size()) {
      const Line& line = next();
      if (has_end) fail(line, "read.unknown", "something stands after END");
      has_end = line.text == "END";
      job.instructions.push_back(line);
    }
    if (!has_end) fail(job.head, "read.missing", "END is missing");
    const std::string name = job.name;
    if (!out_.jobs.emplace(name, std::move(job)).second) fail({&f.name, 2, {}}, "read.name", "two jobs are called " + name);
    return name;
  }

  template <class Next>
  void instruction_head(Next&& next, Job& job) {
    bool has_group = false;
    for (;;) {
      const Line& line = next();
      Scanner s(line);
      if (s.accept("///DATE")) {
        s.expect_integer("the year", 1990, 2200), s.expect("/"), s.expect_integer("the month", 1, 12), s.expect("/");
        s.expect_integer("the day", 1, 31), s.expect_integer("the hour", 0, 23), s.expect(":"), s.expect_integer("the minute", 0, 59);
      } else if (s.accept("///COMM")) {
        if (s.rest().size() > 32) fail(line, "read.range", "a job comment has at most 32 characters", static_cast<double>(s.rest().size()), 32);
        continue;
      } else if (s.accept("///ATTR")) {
        do {
          const std::string a = s.name();
          if (a == "RJ") job.is_relative = true;
          else if (a != "SC" && a != "RW" && a != "RO" && a != "WO") s.unknown();
        } while (s.accept(","));
      } else if (s.accept("///FRAME")) {
        if (!job.is_relative || job.has_frame) fail(line, "read.unknown", "///FRAME belongs to a relative job (RJ), once");
        job.has_frame = true;
        if (s.accept("USER")) job.frame_user = s.expect_integer("the user frame", 1, 63);
        else if (!s.accept("BASE")) s.expect("ROBOT");
      } else if (s.accept("///GROUP1")) {
        s.expect("RB1");
        has_group = true;
      } else if (s.accept("NOP")) {
        s.expect_end();
        if (!has_group) fail(line, "read.missing", "///GROUP1 is missing");
        if (job.is_relative && !job.has_frame) fail(line, "read.missing", "a relative job names the frame its positions are in (///FRAME)");
        for (const auto& [name, p] : job.positions)
          if (job.is_relative && (p.is_joint || p.user != job.frame_user))
            fail(p.line, "read.unknown", "a relative job holds Cartesian positions in the frame it names; " + name + " is none", p.user, job.frame_user);
        return;
      } else {
        s.unknown();
      }
      s.expect_end();
    }
  }

  void position(Scanner& s, Job& job, const std::optional<int>& count, const std::optional<int>& tool, const std::optional<int>& user,
                const std::string& type, bool is_rectan, bool has_rconf) {
    const Line line = s.line();
    if (!count || !tool || type.empty()) fail(line, "read.order", "a position before ///NPOS, ///TOOL and ///POSTYPE");
    char expected[16];
    std::snprintf(expected, sizeof expected, "C%05zu", job.positions.size());
    if (!s.accept(expected)) fail(line, "read.count", std::string("expected position ") + expected, static_cast<double>(job.positions.size()));
    s.expect("=");
    const auto v = six(s);
    Position p;
    p.line = line;
    p.tool = *tool;
    if (type == "PULSE") {
      if (!context_.cell.controller.pulses_per_degree)
        fail(line, "read.undefined", "pulses cannot be read without controller.inform.pulses_per_degree in cell.yaml");
      p.is_joint = true;
      for (int i = 0; i < 6; ++i) {
        if (v[i] != std::floor(v[i])) fail(line, "read.range", "pulses are whole numbers", v[i]);
        p.q_deg[i] = v[i] / (*context_.cell.controller.pulses_per_degree)[i];
      }
    } else {
      if (!is_rectan || !has_rconf) fail(line, "read.order", "a Cartesian position before ///RECTAN and ///RCONF");
      if (type == "USER") {
        if (!user) fail(line, "read.order", "a position in USER before ///USER");
        if (!out_.user_frames.count(*user))
          fail(line, "read.undefined", "user frame " + std::to_string(*user) + " is on the controller and not in UFRAME.CND", *user);
        p.user = *user;
      }
      p.T_work_tool = {rotation(v), Vec3(v[0], v[1], v[2])};
      p.flags = rconf_;
    }
    job.positions.emplace(expected, p);
  }
};

}  // namespace

Jobs load_jobs(const ProgramText& text, const PostContext& context) { return Loader(context).load_all(text); }

}  // namespace asbuilt::inform
