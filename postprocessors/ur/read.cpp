// SPDX-License-Identifier: GPL-3.0-or-later
// UR script -> neutral program. A whitelist written from dialect.md: one function of calls with literal numbers. What is outside it is a
// refusal with file and line, never a guess.
#include <cmath>

#include "postprocessors/reading.hpp"
#include "postprocessors/ur/ur.hpp"

namespace asbuilt::ur {
namespace {

using namespace reading;

class Reader {
 public:
  Reader(const ProgramText& text, const PostContext& context) : text_(text), context_(context), build_(context) {}

  Program read() {
    if (text_.files.size() != 1) fail({}, "read.file", "a UR program is one .script file", static_cast<double>(text_.files.size()), 1);
    bool has_head = false, has_end = false, has_code = false;
    const auto lines = lines_of(text_.files.front());
    for (const Line& line : lines) {
      const std::size_t hash = line.text.find('#');
      Scanner s(line, line.text.substr(0, hash));
      if (s.at_end()) {
        if (hash == std::string_view::npos || !has_head) continue;
        std::string_view remark = line.text.substr(hash + 1);
        if (remark.starts_with(" ")) remark.remove_prefix(1);
        if (has_code) build_.comment(remark);
        else build_.program.header.emplace_back(remark);
        continue;
      }
      if (has_end) fail(line, "read.unknown", "something stands after the end of the program");
      if (!has_head) {
        s.expect("def");
        Scanner name = s;
        if (name.name().empty()) s.unknown();
        const std::string_view rest = s.rest();
        build_.program.name = std::string(rest.substr(0, rest.find('(')));
        name.expect("("), name.expect(")"), name.expect(":"), name.expect_end();
        has_head = true;
        continue;
      }
      if (s.accept("end")) {
        s.expect_end(), has_end = true;
        continue;
      }
      has_code = true;
      call(s);
      s.expect_end();
    }
    if (!has_end) fail(lines.empty() ? Line{&text_.files.front().name, 0, {}} : lines.back(), "read.missing", "end is missing");
    return std::move(build_.program);
  }

 private:
  const ProgramText& text_;
  const PostContext& context_;
  Builder build_;

  static std::array<double, 6> six(Scanner& s) {
    std::array<double, 6> v{};
    s.expect("[");
    for (std::size_t i = 0; i < 6; ++i) {
      if (i) s.expect(",");
      v[i] = s.expect_number("a number");
    }
    s.expect("]");
    return v;
  }
  template <class A, class B>
  static Pose<A, B> pose(Scanner& s) {
    s.expect("p");
    const auto v = six(s);
    const Vec3 w(v[3], v[4], v[5]);
    const double angle = w.norm();
    if (angle > 7) fail(s.line(), "read.range", "a rotation vector is longer than a whole turn", angle, 6.3, "rad");
    const Eigen::Quaterniond q = angle < 1e-12 ? Eigen::Quaterniond::Identity() : Eigen::Quaterniond(Eigen::AngleAxisd(angle, w / angle));
    return {q, 1000 * Vec3(v[0], v[1], v[2])};
  }
  static double named(Scanner& s, std::string_view key) {
    s.expect(","), s.expect(key), s.expect("=");
    return s.expect_number("a number");
  }
  void acceleration(Scanner& s) {
    const double a = named(s, "a");
    if (!(a > 0)) fail(s.line(), "read.range", "an acceleration is above 0", a, 0);
  }

  void call(Scanner& s) {
    const Line line = s.line();
    if (s.accept("movej")) {
      s.expect("(");
      std::array<double, 6> q = six(s);
      for (double& x : q) x *= 57.29577951308232;
      acceleration(s);
      const double v = named(s, "v");
      double slowest = 1e300;
      for (const JointSpec& j : context_.cell.robot.joints) slowest = std::min(slowest, j.speed_rad_s);
      if (!(v > 0) || v > slowest * 1.0001) fail(line, "read.range", "v is beyond the slowest joint", v, slowest, "rad/s");
      build_.joint(line, q, std::min(1.0, v / slowest));
    } else if (s.accept("movel")) {
      s.expect("(");
      const auto T = pose<frame::Work, frame::Tool>(s);
      build_.set_frame(line, {});
      acceleration(s);
      const double v = named(s, "v"), r = named(s, "r");
      if (!(r >= 0)) fail(line, "read.range", "r is negative", r, 0, "m");
      build_.linear(line, T, 1000 * v, 1000 * r);
    } else if (s.accept("movec")) {
      s.expect("(");
      const auto via = pose<frame::Work, frame::Tool>(s);
      s.expect(",");
      const auto T = pose<frame::Work, frame::Tool>(s);
      build_.set_frame(line, {});
      acceleration(s);
      const double v = named(s, "v"), r = named(s, "r");
      if (!(r >= 0)) fail(line, "read.range", "r is negative", r, 0, "m");
      if (named(s, "mode") != 0) fail(line, "read.unknown", "an arc with a fixed orientation (mode 1) is not read");
      build_.circular(line, via, T, 1000 * v, 1000 * r);
    } else if (s.accept("set_tcp")) {
      s.expect("(");
      build_.set_tool_pose(line, pose<frame::Flange, frame::Tool>(s));
    } else if (s.accept("set_standard_digital_out") || s.accept("set_configurable_digital_out")) {
      const bool is_standard = line.text.find("standard") != std::string_view::npos;
      s.expect("(");
      const int n = s.expect_integer("the output", 0, 7) + (is_standard ? 0 : 8);
      s.expect(",");
      const bool on = s.accept("True");
      if (!on) s.expect("False");
      build_.digital_output(line, n, on);
    } else if (s.accept("set_standard_analog_out")) {
      s.expect("(");
      const int n = s.expect_integer("the output", 0, 31);
      s.expect(",");
      build_.analog_ratio(line, n, s.expect_number("the value"));
    } else if (s.accept("sleep")) {
      s.expect("(");
      build_.wait(line, s.expect_number("the time"));
    } else {
      s.unknown();
    }
    s.expect(")");
  }
};

}  // namespace

Result<Program> read(const ProgramText& text, const PostContext& context) {
  return reading::guarded([&]() -> Result<Program> { return Reader(text, context).read(); });
}

}  // namespace asbuilt::ur
