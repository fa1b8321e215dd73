// SPDX-License-Identifier: GPL-3.0-or-later
// Broken, hostile and empty files: a refusal or a fault with file, line and entity, never a crash, a hang or much memory.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>

#include "planner/base/random.hpp"
#include "planner/io/step/p21.hpp"
#include "planner/io/step/step_reader.hpp"
#include "step_text.hpp"

namespace asbuilt {
namespace {

using test::StepText;

std::string code_of(const std::string& text) {
  const auto r = read_step(text, "bad.step");
  if (r) return "read";
  EXPECT_EQ(r.error()[0].where.rfind("bad.step:", 0), 0u) << r.error()[0].where;
  EXPECT_FALSE(r.error()[0].message.empty());
  EXPECT_EQ(r.error()[0].stage, "input");
  return r.error()[0].code;
}

std::string cube_text() {
  StepText s;
  s.part({test::add_box(s, {0, 0, 0}, {30, 20, 10})});
  return s.text();
}

TEST(StepRefusal, NotStep) {
  EXPECT_EQ(code_of(""), "step.not_step");
  EXPECT_EQ(code_of("solid stl\nfacet normal 0 0 1\n"), "step.not_step");
  EXPECT_EQ(code_of(std::string(100000, '\0')), "step.not_step");
}

TEST(StepRefusal, CutInTheMiddle) {
  const std::string text = cube_text();
  const std::size_t data = text.find("DATA;"), end = text.find("ENDSEC;", data);
  for (std::size_t n = data; n < end; n += 37) EXPECT_EQ(code_of(text.substr(0, n)), "step.truncated") << n;
  EXPECT_EQ(code_of(text.substr(0, text.find("ENDSEC;"))), "step.truncated");
  EXPECT_EQ(code_of(text.substr(0, end + 7)), "read");  // only the last line is missing
}

TEST(StepRefusal, NoBody) {
  StepText s;
  s.point({1, 2, 3});
  EXPECT_EQ(code_of(s.text()), "step.no_body");
  StepText e;
  e.part({e.solid({})});
  EXPECT_EQ(code_of(e.text()), "step.no_body");
}

TEST(StepRefusal, TheRestOfThePartStillComesIn) {
  std::string text = cube_text();
  const std::size_t at = text.find("=PLANE(");
  text.replace(at, 7, "=PLAIN(");
  const auto r = read_step(text, "bad.step");
  ASSERT_TRUE(r);
  EXPECT_EQ(r->artefact.faces.size(), 6u);
  int faults = 0;
  for (const BrepFace& f : r->artefact.faces) faults += !f.fault.empty();
  EXPECT_EQ(faults, 1);
  ASSERT_EQ(r->artefact.unread.size(), 1u);
  EXPECT_EQ(r->artefact.unread[0].entity, "PLAIN");
  EXPECT_GT(r->artefact.unread[0].line, 7);
  EXPECT_NE(r->artefact.unread[0].why.find("PLAIN: a kind of surface that is not known"), std::string::npos) << r->artefact.unread[0].why;
  EXPECT_EQ(r->artefact.open_edges_count, 0);  // the hole is closed by a flat stand-in, named in the fault
}

TEST(StepRefusal, MissingReferenceNamesIt) {
  std::string text = cube_text();
  const std::size_t at = text.find("ADVANCED_FACE");
  const std::size_t hash = text.rfind('#', text.find(",.T.)", at));
  text.insert(hash + 1, "99999");
  const auto r = read_step(text, "bad.step");
  ASSERT_TRUE(r);
  ASSERT_FALSE(r->artefact.unread.empty());
  EXPECT_NE(r->artefact.unread[0].why.find("is referred to and not in the file"), std::string::npos);
}

TEST(StepRefusal, CyclesEnd) {
  // A trimmed curve on itself, an offset surface on itself, a shell in itself, a product in itself, a map in itself.
  StepText s;
  const int solid = test::add_box(s, {0, 0, 0}, {1, 1, 1});
  const std::string n = std::to_string(s.add("TRIMMED_CURVE('',#0,(PARAMETER_VALUE(0.)),(PARAMETER_VALUE(1.)),.T.,.PARAMETER.)"));
  s.lines().back() = "#" + n + "=TRIMMED_CURVE('',#" + n + ",(PARAMETER_VALUE(0.)),(PARAMETER_VALUE(1.)),.T.,.PARAMETER.);";
  const int v = s.vertex({0, 0, 0});
  const int e = s.edge(v, v, std::stoi(n));
  const std::string o = std::to_string(s.add("OFFSET_SURFACE('',#0,1.,.F.)"));
  s.lines().back() = "#" + o + "=OFFSET_SURFACE('',#" + o + ",1.,.F.);";
  const int bad_face = s.face({s.bound({e})}, std::stoi(o));
  const std::string c = std::to_string(s.add("ORIENTED_CLOSED_SHELL('',*,#0,.T.)"));
  s.lines().back() = "#" + c + "=ORIENTED_CLOSED_SHELL('',*,#" + c + ",.T.);";
  const int bad_solid = s.add("MANIFOLD_SOLID_BREP('',#" + c + ")");
  const int context = s.context();
  const int rep = s.representation({solid, s.solid({bad_face}), bad_solid}, context);
  const int a = s.product("a"), b = s.product("b");
  s.define(a, rep);
  s.add("NEXT_ASSEMBLY_USAGE_OCCURRENCE('','',''," + s.ref(a) + "," + s.ref(b) + ",$)");
  s.add("NEXT_ASSEMBLY_USAGE_OCCURRENCE('','',''," + s.ref(b) + "," + s.ref(a) + ",$)");
  const auto r = read_step(s.text(), "bad.step");
  ASSERT_TRUE(r) << r.error()[0].message;
  EXPECT_EQ(r->artefact.faces.size(), 7u);
  EXPECT_GE(r->artefact.unread.size(), 2u);
}

TEST(StepRefusal, DeepNestingAndLongListsAreFaults) {
  std::string text = cube_text();
  const std::string deep = "#900001=X(" + std::string(1'000'000, '(') + std::string(1'000'000, ')') + ");\n";
  std::string wide = "#900002=X((";
  for (int i = 0; i < 200000; ++i) wide += "1,";
  wide += "1));\n";
  text.insert(text.find("DATA;") + 6, deep + wide);
  const auto r = read_step(text, "bad.step");
  ASSERT_TRUE(r);
  EXPECT_EQ(r->artefact.faces.size(), 6u);
  ASSERT_EQ(r->artefact.unread.size(), 1u);
  EXPECT_NE(r->artefact.unread[0].why.find("8: #900001"), std::string::npos) << r->artefact.unread[0].why;
  EXPECT_NE(r->artefact.unread[0].why.find("deeper than 64"), std::string::npos);
}

TEST(StepRefusal, AnAssemblyThatDoublesAtEveryLevel) {
  StepText s;
  const int context = s.context();
  int child = s.product("leaf");
  s.define(child, s.representation({test::add_box(s, {0, 0, 0}, {1, 1, 1})}, context));
  for (int level = 0; level < 40; ++level) {
    const int parent = s.product("level");
    for (int k = 0; k < 2; ++k) s.add("NEXT_ASSEMBLY_USAGE_OCCURRENCE('','',''," + s.ref(parent) + "," + s.ref(child) + ",$)");
    child = parent;
  }
  EXPECT_EQ(code_of(s.text()), "step.limits");
}

TEST(StepRefusal, HugeAndTinyNumbers) {
  for (const std::string number : {"1E308", "-1E308", "1E400", "1E-320", "123456789012345678901234567890.", "1E99999999999"}) {
    std::string text = cube_text();
    const std::size_t at = text.find("30.");
    text.replace(at, 3, number);
    const auto r = read_step(text, "bad.step");
    if (!r) continue;
    for (const Vec3& v : r->artefact.mesh.vertices) EXPECT_TRUE(v.allFinite());
  }
}

TEST(StepRefusal, DuplicateIdsAreNamedAndTheFirstCounts) {
  std::string text = cube_text();
  text.insert(text.rfind("ENDSEC;"), "#1=CARTESIAN_POINT('',(5.,5.,5.));\n");
  const auto r = read_step(text, "bad.step");
  ASSERT_TRUE(r);
  EXPECT_NEAR(r->artefact.volume_mm3, 6000, 1e-9);
  ASSERT_EQ(r->artefact.unread.size(), 1u);
  EXPECT_NE(r->artefact.unread[0].why.find("used twice"), std::string::npos);
}

TEST(StepRefusal, MutationsNeverCrash) {
  StepText s;
  const int v = s.vertex({4, 0, 3}), e = s.edge(v, v, s.circle({0, 0, 3}, Vec3::UnitZ(), Vec3::UnitX(), 4));
  const std::string at = s.ref(s.axes({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX()));
  const int ball = s.face({s.bound({e})}, s.add("SPHERICAL_SURFACE(''," + at + ",5.)"));
  const int cone =
      s.face({s.bound({-e}), s.vertex_bound(s.vertex({0, 0, 0}))}, s.add("CONICAL_SURFACE(''," + at + ",0.,0.9272952180016122)"));
  const int ring = s.face({s.vertex_bound(v)}, s.add("TOROIDAL_SURFACE(''," + at + ",10.,3.)"));
  s.part({test::add_box(s, {0, 0, 0}, {30, 20, 10}), test::add_seamless_cylinder(s, 3, 50), s.solid({ball, cone}), s.solid({ring})});
  const std::string text = s.text();
  {
    const auto whole = read_step(text, "good.step");
    ASSERT_TRUE(whole);
    EXPECT_EQ(whole->artefact.open_edges_count, 0);
    EXPECT_TRUE(whole->artefact.unread.empty());
    EXPECT_NEAR(whole->artefact.volume_mm3, 6000 + kPi * 9 * 50 + (kPi * 4 * (15 - 2) / 3 + kPi * 16 * 3 / 3) + 2 * kPi * kPi * 10 * 9,
                1.5);
  }
  Random random(11);
  const auto t0 = std::chrono::steady_clock::now();
  StepOptions options;
  options.chord_mm = 0.5, options.angle_rad = 0.6;
  for (int k = 0; k < 1500; ++k) {
    std::string m = text;
    for (int c = 0; c < 1 + k % 4; ++c) {
      const std::size_t at = random.below(m.size());
      switch (random.below(5)) {
        case 0:
          m[at] = static_cast<char>(random.below(256));
          break;
        case 1:
          m.erase(at, 1 + random.below(20));
          break;
        case 2:
          m.insert(at, m.substr(random.below(m.size()), random.below(40)));
          break;
        case 3:
          m[at] = "0123456789.#,()'$*"[random.below(18)];
          break;
        default: {  // another reference
          const std::size_t h = m.find('#', at);
          if (h != std::string::npos) m.replace(h, 2, "#" + std::to_string(random.below(300)));
        }
      }
    }
    const auto r = read_step(m, "bad.step", options);
    if (!r) {
      EXPECT_EQ(r.error()[0].where.rfind("bad.step:", 0), 0u);
    }
  }
  EXPECT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - t0).count(), 120);
}

TEST(P21, NumbersAreExact) {
  p21::File f;
  const std::string text =
      "ISO-10303-21;HEADER;ENDSEC;DATA;#7=X(1.,-0.5,1.E-07,+3.25E2,0.1,123456789.123456789,1E3,42,.5,2.2250738585072014E-308);ENDSEC;END-"
      "ISO-10303-21;";
  ASSERT_FALSE(p21::parse(text, f));
  const double want[] = {1., -0.5, 1e-7, 325, 0.1, 123456789.123456789, 1e3, 0, 0.5, 2.2250738585072014e-308};
  const p21::Value* v = f.values.data() + f.records[0].first;
  for (int i = 0; i < 10; ++i, v = p21::next(v)) {
    if (i == 7) {
      EXPECT_EQ(v->integer, 42);
    } else {
      EXPECT_EQ(v->real, want[i]);
    }
  }
}

TEST(P21, StringsAreDecoded) {
  EXPECT_EQ(p21::decoded("it''s"), "it's");
  EXPECT_EQ(p21::decoded("a\\\\b"), "a\\b");
  EXPECT_EQ(p21::decoded("\\X\\E9"), "\xC3\xA9");
  EXPECT_EQ(p21::decoded("\\X2\\30D630ED\\X0\\x"), "\xE3\x83\x96\xE3\x83\xADx");
  EXPECT_EQ(p21::decoded("\\X4\\0001F600\\X0\\"), "\xF0\x9F\x98\x80");
  EXPECT_EQ(p21::decoded("\\S\\i"), "\xC3\xA9");
  EXPECT_EQ(p21::decoded("Materials\\Material"), "Materials\\Material");
  EXPECT_EQ(p21::decoded("caf\xE9"), "caf\xC3\xA9");      // Latin-1
  EXPECT_EQ(p21::decoded("caf\xC3\xA9"), "caf\xC3\xA9");  // UTF-8
}

TEST(P21, ComplexInstancesInAnyOrder) {
  p21::File f;
  ASSERT_FALSE(
      p21::parse("ISO-10303-21;HEADER;ENDSEC;DATA;#3=(SI_UNIT(.MILLI.,.METRE.)NAMED_UNIT(*)LENGTH_UNIT());ENDSEC;END-ISO-10303-21;", f));
  ASSERT_EQ(f.instances.size(), 1u);
  EXPECT_EQ(f.instances[0].record_count, 3u);
  EXPECT_EQ(f.keyword_name(f.records[0].keyword), "SI_UNIT");
  EXPECT_EQ(f.find(3), &f.instances[0]);
  EXPECT_EQ(f.find(4), nullptr);
}

}  // namespace
}  // namespace asbuilt
