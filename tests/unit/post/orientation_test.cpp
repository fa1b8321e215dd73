// SPDX-License-Identifier: GPL-3.0-or-later
// The printed angles against an independent computation: 2000 rotations per dialect and convention, numbers taken from the
// emitted text, matrices multiplied here from elementary rotations.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <regex>

#include "tests/support/post_programs.hpp"

namespace asbuilt {
namespace {

using namespace support;
using Matrix = std::array<std::array<double, 3>, 3>;

Matrix times(const Matrix& a, const Matrix& b) {
  Matrix c{};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k) c[i][j] += a[i][k] * b[k][j];
  return c;
}
Matrix about(char axis, double deg) {
  const double c = std::cos(deg * M_PI / 180), s = std::sin(deg * M_PI / 180);
  if (axis == 'x') return {{{1, 0, 0}, {0, c, -s}, {0, s, c}}};
  if (axis == 'y') return {{{c, 0, s}, {0, 1, 0}, {-s, 0, c}}};
  return {{{c, -s, 0}, {s, c, 0}, {0, 0, 1}}};
}

/// A rotation vector, by Rodrigues' formula.
Matrix about_vector(double x, double y, double z) {
  const double angle = std::sqrt(x * x + y * y + z * z);
  const double s = angle < 1e-12 ? 1 : std::sin(angle) / angle, c = angle < 1e-12 ? 0.5 : (1 - std::cos(angle)) / (angle * angle);
  const Matrix k = {{{0, -z, y}, {z, 0, -x}, {-y, x, 0}}}, k2 = times(k, k);
  Matrix r{};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) r[i][j] = (i == j ? 1 : 0) + s * k[i][j] + c * k2[i][j];
  return r;
}

struct Convention {
  const char* name;
  Language language;
  BeckhoffOrientation mode;
  const char* pattern;  // three groups: the angles in the order they stand
  Matrix (*matrix)(double, double, double);
};
const Convention kConventions[] = {
    {"krl", Language::krl, BeckhoffOrientation::cba, R"(LIN \{X [-\d.]+,Y [-\d.]+,Z [-\d.]+,A ([-\d.]+),B ([-\d.]+),C ([-\d.]+)\})",
     [](double a, double b, double c) { return times(about('z', a), times(about('y', b), about('x', c))); }},
    {"inform", Language::inform, BeckhoffOrientation::cba, R"(C00001=[-\d.]+,[-\d.]+,[-\d.]+,([-\d.]+),([-\d.]+),([-\d.]+))",
     [](double rx, double ry, double rz) { return times(about('z', rz), times(about('y', ry), about('x', rx))); }},
    {"cba", Language::beckhoff, BeckhoffOrientation::cba, R"(G01 X-?\d+\.\d{3} Y[-\d.]+ Z[-\d.]+ A([-\d.]+) B([-\d.]+) C([-\d.]+))",
     [](double a, double b, double c) { return times(about('z', a), times(about('y', b), about('x', c))); }},
    {"ypr", Language::beckhoff, BeckhoffOrientation::ypr, R"(G01 X-?\d+\.\d{3} Y[-\d.]+ Z[-\d.]+ A([-\d.]+) B([-\d.]+) C([-\d.]+))",
     [](double a, double b, double c) { return times(about('z', c), times(about('y', -b), about('x', a))); }},
    {"euler", Language::beckhoff, BeckhoffOrientation::euler, R"(G01 X-?\d+\.\d{3} Y[-\d.]+ Z[-\d.]+ A([-\d.]+) B([-\d.]+) C([-\d.]+))",
     [](double a, double b, double c) { return times(about('z', c), times(about('y', b), about('z', a))); }},
    {"nci_cba", Language::nci, BeckhoffOrientation::cba, R"(G01 X-?\d+\.\d{3} Y[-\d.]+ Z[-\d.]+ Q1=([-\d.]+) Q2=([-\d.]+) Q3=([-\d.]+))",
     [](double a, double b, double c) { return times(about('z', a), times(about('y', b), about('x', c))); }},
    {"nci_ypr", Language::nci, BeckhoffOrientation::ypr, R"(G01 X-?\d+\.\d{3} Y[-\d.]+ Z[-\d.]+ Q1=([-\d.]+) Q2=([-\d.]+) Q3=([-\d.]+))",
     [](double a, double b, double c) { return times(about('z', c), times(about('y', -b), about('x', a))); }},
    {"nci_euler", Language::nci, BeckhoffOrientation::euler, R"(G01 X-?\d+\.\d{3} Y[-\d.]+ Z[-\d.]+ Q1=([-\d.]+) Q2=([-\d.]+) Q3=([-\d.]+))",
     [](double a, double b, double c) { return times(about('z', c), times(about('y', b), about('z', a))); }},
    {"ur", Language::ur, BeckhoffOrientation::cba, R"(movel\(p\[[-\d.]+, [-\d.]+, [-\d.]+, ([-\d.]+), ([-\d.]+), ([-\d.]+)\])", about_vector},
};

class Orientation : public testing::TestWithParam<Convention> {};

TEST_P(Orientation, printed_angles_name_the_rotation) {
  const Convention& v = GetParam();
  PostContext context = post_context();
  context.cell.controller.orientation = v.mode;
  context.cell.controller.options["nci.orientation"] = std::string(name_of(v.mode));
  const Post& post = *find_post(v.language);
  const std::regex pattern(v.pattern);
  Random random(20261122);
  for (int n = 0, seen = 0; seen < 2000; ++n) {
    ASSERT_LT(n, 4000);
    const Eigen::Quaterniond q = random_rotation(random);
    Program p;
    p.name = "TURN";
    p.instructions = {SetTool{1, context.cell.tools[0].T_flange_tool}, SetFrame{}, MoveJoint{context.cell.robot.home_rad, 0.5},
                      MoveLinear{{q, Vec3(10, 20, 100)}, 10, true, 0}, MoveJoint{context.cell.robot.home_rad, 0.5}};
    const auto text = post.write(p, context);
    if (!text && text.error().front().code == "post.pole") continue;  // NC I cannot be there at all
    ASSERT_TRUE(text) << text_of(text.error());
    ++seen;
    std::smatch m;
    ASSERT_TRUE(std::regex_search(text->files[0].bytes, m, pattern)) << text->files[0].bytes;
    Matrix R = v.matrix(std::stod(m[1]), std::stod(m[2]), std::stod(m[3]));
    const double tolerance = 1.52e-6;
    if (v.language == Language::beckhoff) {  // the section's own frame
      static const std::regex frame_pattern(R"(#CS DEF \[1\]\[[^,]*,[^,]*,[^,]*,([-\d.]+),([-\d.]+),([-\d.]+)\])");
      std::smatch f;
      ASSERT_TRUE(std::regex_search(text->files[0].bytes, f, frame_pattern));
      R = times(times(about('z', std::stod(f[3])), times(about('y', std::stod(f[2])), about('x', std::stod(f[1])))), R);
      EXPECT_LE(std::abs(std::stod(m[1])), 120) << text->files[0].bytes;  // never near the wrap
      EXPECT_LE(std::abs(std::stod(m[3])), 120);
    }
    const Mat3 wanted = q.toRotationMatrix();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) ASSERT_NEAR(R[i][j], wanted(i, j), tolerance) << "rotation " << n << " " << m[0];
    const auto back = post.read(*text, context);
    ASSERT_TRUE(back);
    for (const Instruction& i : back->instructions) {
      const auto* l = std::get_if<MoveLinear>(&i);
      for (int e = 0; l && e < 9; ++e) ASSERT_NEAR(l->T_base_tool.rotation()(e / 3, e % 3), R[e / 3][e % 3], 1e-12);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, Orientation, testing::ValuesIn(kConventions), [](const auto& info) { return std::string(info.param.name); });

/// The conventions are not the same: reading one channel's text as another's turns the tool by tens of degrees.
TEST(Orientation, a_wrong_mode_is_far_off) {
  PostContext context = post_context();
  const Post& post = *find_post(Language::beckhoff);
  const auto text = post.write(random_program(3, {.has_arcs = false}), context);
  ASSERT_TRUE(text);
  PostContext other = context;
  other.cell.controller.orientation = BeckhoffOrientation::ypr;
  const auto a = post.read(*text, context), b = post.read(*text, other);
  ASSERT_TRUE(a && b);
  double worst = 0;
  for (std::size_t i = 0; i < a->instructions.size(); ++i)
    if (const auto* l = std::get_if<MoveLinear>(&a->instructions[i]))
      worst = std::max(worst, quat_log(l->T_base_tool.q.conjugate() * std::get<MoveLinear>(b->instructions[i]).T_base_tool.q).norm());
  EXPECT_GT(worst, rad_from_deg(30));
}

/// Beckhoff interpolates A, B, C one by one: along a smooth path no word may jump by more than half a turn.
TEST(Orientation, beckhoff_angles_run_on_without_a_jump) {
  for (BeckhoffOrientation mode : {BeckhoffOrientation::cba, BeckhoffOrientation::ypr, BeckhoffOrientation::euler}) {
    PostContext context = post_context();
    context.cell.controller.orientation = mode;
    Program p;
    p.name = "TURN";
    p.instructions = {SetTool{1, context.cell.tools[0].T_flange_tool}, SetFrame{}, MoveJoint{context.cell.robot.home_rad, 0.5}};
    for (int i = 0; i <= 200; ++i)  // two whole turns about a tilted axis, through 180 degrees
      p.instructions.emplace_back(MoveLinear{{Eigen::Quaterniond(Eigen::AngleAxisd(i * 0.0628, Vec3::UnitZ())) * quat_from_zyx(0, 0.4, 3.0), Vec3(i, 0, 0)}, 10, true, 0});
    p.instructions.emplace_back(MoveJoint{context.cell.robot.home_rad, 0.5});
    const auto text = find_post(Language::beckhoff)->write(p, context);
    ASSERT_TRUE(text);
    std::array<double, 3> before{};
    bool has_before = false;
    const std::regex pattern(R"(G01 X-?\d+\.\d{3} Y[-\d.]+ Z[-\d.]+ A([-\d.]+) B([-\d.]+) C([-\d.]+))");
    const std::string& s = text->files[0].bytes;
    for (std::sregex_iterator it(s.begin(), s.end(), pattern), end; it != end; ++it) {
      for (int k = 0; k < 3; ++k) {
        const double v = std::stod((*it)[k + 1]);
        EXPECT_TRUE(!has_before || std::abs(v - before[k]) < 20) << name_of(mode);
        before[k] = v;
      }
      has_before = true;
    }
    EXPECT_TRUE(has_before);
  }
}

}  // namespace
}  // namespace asbuilt
