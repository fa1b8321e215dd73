// SPDX-License-Identifier: GPL-3.0-or-later
// The same box and drum in other units, places, assemblies and file frames: line ends, headers, ids, sections, encodings.
#include <gtest/gtest.h>

#include <algorithm>

#include "variants.hpp"
#include "variants_check.hpp"

namespace asbuilt {
namespace {

using test::StepText;
using test::Truth;

const Vec3 kX = Vec3::UnitX(), kY = Vec3::UnitY(), kZ = Vec3::UnitZ();
const Truth kBox{6000, 2200, 240, 6, 1};  // 30 x 20 x 10

std::string box_text(const Vec3& at = Vec3::Zero()) {
  StepText s;
  s.part({test::add_box(s, at, at + Vec3(30, 20, 10))});
  return s.text();
}
std::string replaced(std::string text, const std::string& a, const std::string& b) {
  for (std::size_t at = text.find(a); at != std::string::npos; at = text.find(a, at + b.size())) text.replace(at, a.size(), b);
  return text;
}

TEST(Frames, LineEnds) {
  test::expect_truth(replaced(box_text(), "\n", "\r"), kBox);
  test::expect_truth(replaced(box_text(), "\n", "\r\n"), kBox);
  test::expect_truth(replaced(box_text(), "\n", ""), kBox);
  test::expect_truth(replaced(box_text(), "\n", "\n\n \t"), kBox);
}
TEST(Frames, LinesAreCountedWhateverTheyEndIn) {
  for (const std::string end : {"\n", "\r\n", "\r"}) {
    const auto r = read_step(replaced(replaced(box_text(), "=PLANE(", "=PLAIN("), "\n", end), "made.step");
    ASSERT_TRUE(r);
    ASSERT_FALSE(r->artefact.unread.empty());
    const std::string text = box_text();
    const int want = 1 + static_cast<int>(std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(text.find("=PLANE(")), '\n'));
    EXPECT_EQ(r->artefact.unread[0].line, want);
  }
}
TEST(Frames, Headers) {
  const std::string text = box_text();
  const auto with_schema = [&](const std::string& s) { return replaced(text, "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));", s); };
  for (const std::string s : {"FILE_SCHEMA(('CONFIG_CONTROL_DESIGN'));",
                              "FILE_SCHEMA (( 'AP242_MANAGED_MODEL_BASED_3D_ENGINEERING_MIM_LF { 1 0 10303 442 1 1 4 }' )) ;",
                              "FILE_SCHEMA(('AUTOMOTIVE_DESIGN_CC2','X'));", "FILE_SCHEMA(('NO SUCH SCHEMA'));", "FILE_SCHEMA(());", "",
                              "file_schema(('automotive_design'));"})
    test::expect_truth(with_schema(s), kBox);
  const std::size_t header = text.find("HEADER;"), data = text.find("DATA;");
  test::expect_truth(text.substr(0, header) + text.substr(data), kBox);  // no header at all
  test::expect_truth(replaced(text, "ENDSEC;\nDATA;", "DATA;"), kBox);   // never closed
  test::expect_truth(replaced(text, "ISO-10303-21;\nHEADER;", "ISO-10303-21 ;\n\nHEADER ;"), kBox);
  test::expect_truth(replaced(text, "END-ISO-10303-21;", ""), kBox);
  test::expect_truth(text + std::string(100, '\0'), kBox);
  test::expect_truth("\xEF\xBB\xBF" + text, kBox);
  test::expect_truth(replaced(text, "DATA;", "DATA('part', ('AUTOMOTIVE_DESIGN'));"), kBox);  // edition 3
  test::expect_truth(replaced(text, "DATA;", "ANCHOR;\n<a>=#1;\nENDSEC;\nREFERENCE;\n#900000=<http://x/y#z>;\nENDSEC;\nDATA;"), kBox);
}
TEST(Frames, TwoDataSections) {
  const std::string text = box_text();
  const std::size_t half = text.find("\n", text.size() / 2) + 1;
  test::expect_truth(text.substr(0, half) + "ENDSEC;\nDATA;\n" + text.substr(half), kBox);
}
TEST(Frames, IdsAndWords) {
  const std::string text = box_text();
  std::string far = text, lower = text;
  for (std::size_t at = far.find('#'); at != std::string::npos; at = far.find('#', at + 1)) far.insert(at + 1, "70000000000");
  test::expect_truth(far, kBox);
  for (std::size_t k = lower.find("DATA;") + 5; k < lower.rfind("ENDSEC"); ++k) lower[k] = static_cast<char>(std::tolower(lower[k]));
  test::expect_truth(lower, kBox);
  test::expect_truth(replaced(replaced(text, "=", " = "), ",", " ,\t"), kBox);
  test::expect_truth(replaced(text, "DATA;\n", "DATA;\n#800001=!OWN_THING('x',(1,2),$);\n#800002=UNKNOWN_ENTITY(#1,.X.,\"0F\",*);\n"),
                     kBox);
  test::expect_truth(replaced(text, "CARTESIAN_POINT('',", "CARTESIAN_POINT('\\X2\\00E4\\X0\\ ''q'' \xE4 /*',"), kBox);
}
TEST(Frames, NumbersAsSystemsWriteThem) {
  test::expect_truth(replaced(box_text(), "30.", "3.E+001"), kBox);
  test::expect_truth(replaced(box_text(), "30.", "+0.30E2"), kBox);
  test::expect_truth(replaced(box_text(), "(0.,0.,0.)", "(-0,0,-0.E0)"), kBox);
  test::expect_truth(replaced(box_text(), "20.", "20.000000000000000000000001"), kBox);
}

/// Box of 30 x 20 x 10 mm written in another unit.
void in_unit(const std::string& name, double mm, const std::function<void(StepText&)>& unit) {
  SCOPED_TRACE(name);
  StepText s;
  unit(s);
  s.part({test::add_box(s, {0, 0, 0}, Vec3(30, 20, 10) / mm)});
  test::expect_truth(s.text(), kBox);
}
TEST(Frames, Units) {
  const auto si = [](const std::string& prefix) {
    return [prefix](StepText& s) { s.length_unit = "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(" + prefix + ",.METRE.))"; };
  };
  in_unit("m", 1000, si("$"));
  in_unit("cm", 10, si(".CENTI."));
  in_unit("um", 1e-3, si(".MICRO."));
  in_unit("order of parts", 1, [](StepText& s) { s.length_unit = "(NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.)LENGTH_UNIT())"; });
  in_unit("inch", 25.4, [](StepText& s) { s.use_inch(); });
  const auto by = [](const std::string& name, double value, const std::string& base) {
    return [=](StepText& s) {
      const int b = s.add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(" + base + ",.METRE.))");
      const int m = s.add("(LENGTH_MEASURE_WITH_UNIT()MEASURE_WITH_UNIT(LENGTH_MEASURE(" + s.real(value) + ")," + s.ref(b) + "))");
      s.length_unit = "(CONVERSION_BASED_UNIT('" + name + "'," + s.ref(m) + ")LENGTH_UNIT()NAMED_UNIT(#999999))";
    };
  };
  in_unit("inch over metre, complex measure, exponents missing", 25.4, by("Inches", 0.0254, "$"));
  in_unit("foot", 304.8, by("FOOT", 304.8, ".MILLI."));
  in_unit("millimetre by name", 1, by("MILLIMETRE", 1, ".MILLI."));
  in_unit("yard over cm", 914.4, by("YARD", 91.44, ".CENTI."));
  in_unit("typed measure missing", 25.4, [](StepText& s) {
    const int mm = s.add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))");
    s.length_unit = "(CONVERSION_BASED_UNIT('INCH'," + s.ref(s.add("LENGTH_MEASURE_WITH_UNIT(25.4," + s.ref(mm) + ")")) +
                    ")LENGTH_UNIT()NAMED_UNIT(*))";
  });
  in_unit("inch over inch", 25.4, [&](StepText& s) {  // a chain of conversions
    s.use_inch();
    const int m = s.add("LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.)," + s.ref(s.add(s.length_unit)) + ")");
    s.length_unit = "(CONVERSION_BASED_UNIT('inch'," + s.ref(m) + ")LENGTH_UNIT()NAMED_UNIT(*))";
  });
}
TEST(Frames, NoUnitsIsMillimetreAndSaid) {
  StepText s;
  const int box = test::add_box(s, {0, 0, 0}, {30, 20, 10});
  s.define(s.product("p"), s.representation({box}, s.add("REPRESENTATION_CONTEXT('','')")));
  test::expect_truth(s.text(), kBox);
  EXPECT_NE(read_step(s.text(), "x")->artefact.units.find("none given"), std::string::npos);
}
TEST(Frames, FarFromTheOrigin) {
  test::expect_truth(box_text({2e5, -3e5, 1e5}), kBox);
  StepText s;
  const int drum = test::add_seamless_cylinder(s, 8, 25);
  const int context = s.context(), origin = s.axes({0, 0, 0}, kZ, kX),
            there = s.axes({1e6, 2e6, -3e5}, Vec3(1, 2, 3).normalized(), Vec3(3, 0, -1).normalized());
  const int rep = s.representation({drum}, context), map = s.add("REPRESENTATION_MAP(" + s.ref(origin) + "," + s.ref(rep) + ")");
  s.define(s.product("far"),
           s.representation({s.add("MAPPED_ITEM(''," + s.ref(map) + "," + s.ref(there) + ")")}, context, "SHAPE_REPRESENTATION"));
  test::expect_truth(s.text(), {kPi * 64 * 25, 2 * kPi * 8 * 33, 32 * kPi, 3, 1});
}
TEST(Frames, TinyAndHugeParts) {
  for (const double size : {1e-2, 1e3, 1e4}) {
    StepText s;
    s.part({test::add_seamless_cylinder(s, 8 * size, 25 * size)});
    StepOptions o;
    o.chord_mm = 1e-3 * size;
    const auto r = read_step(s.text(), "made.step", o);
    ASSERT_TRUE(r);
    EXPECT_EQ(r->artefact.open_edges_count, 0);
    EXPECT_NEAR(r->artefact.volume_mm3 / (kPi * 64 * 25 * size * size * size), 1, 2e-4);
  }
}

// Assemblies.
struct Assembly {
  StepText s;
  int context = 0, rep = 0, part = 0;
  Assembly() {
    context = s.context();
    rep = s.representation({test::add_box(s, {0, 0, 0}, {30, 20, 10})}, context);
    part = s.product("part");
    s.define(part, rep);
  }
  /// Uses `child` in `parent` between two placements; `swapped`: rep_1 is the parent's.
  void use(int parent, int parent_rep, int child, int child_rep, int from, int to, bool swapped = false, const std::string& name = "") {
    const int nauo = s.add("NEXT_ASSEMBLY_USAGE_OCCURRENCE('" + name + "','" + name + "',''," + s.ref(parent) + "," + s.ref(child) + ",$)");
    const int shape = s.add("PRODUCT_DEFINITION_SHAPE('',''," + s.ref(nauo) + ")");
    const int t = s.add("ITEM_DEFINED_TRANSFORMATION('',''," + s.ref(swapped ? to : from) + "," + s.ref(swapped ? from : to) + ")");
    const std::string reps = s.ref(swapped ? parent_rep : child_rep) + "," + s.ref(swapped ? child_rep : parent_rep);
    const int relation = s.add("(REPRESENTATION_RELATIONSHIP('',''," + reps + ")REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(" +
                               s.ref(t) + ")SHAPE_REPRESENTATION_RELATIONSHIP())");
    s.add("CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(" + s.ref(relation) + "," + s.ref(shape) + ")");
  }
};
Truth times(int n) { return {6000.0 * n, 2200.0 * n, 240.0 * n, 6 * n, n}; }

TEST(Assemblies, NestedThreeDeepAndEitherOrder) {
  for (const bool swapped : {false, true}) {
    Assembly a;
    StepText& s = a.s;
    const int here = s.axes({0, 0, 0}, kZ, kX), in_part = a.s.axes({0, 0, 0}, kZ, kX);
    const int up = s.axes({0, 0, 100}, kX, kY), side = s.axes({200, 0, 0}, kZ, kX), in_sub = s.axes({0, 0, 0}, kZ, kX);
    s.lines();
    const int sub = s.product("sub"), top = s.product("top");
    const int sub_rep = s.representation({here, up}, a.context, "SHAPE_REPRESENTATION"),
              top_rep = s.representation({side, in_sub}, a.context, "SHAPE_REPRESENTATION");
    s.define(sub, sub_rep), s.define(top, top_rep);
    a.use(sub, sub_rep, a.part, a.rep, in_part, here, swapped, "one");
    a.use(sub, sub_rep, a.part, a.rep, in_part, up, swapped, "two");
    a.use(top, top_rep, sub, sub_rep, here, side, swapped, "left");
    a.use(top, top_rep, sub, sub_rep, here, in_sub, swapped, "right");
    test::expect_truth(s.text(), times(4));
    const Brep b = read_step(s.text(), "x")->artefact;
    EXPECT_LT((b.box.max_mm - Vec3(230, 30, 120)).norm(), 1e-6) << b.box.max_mm.transpose() << " swapped " << swapped;
  }
}
TEST(Assemblies, EachComponentInItsOwnUnit) {
  StepText s;
  const int mm = s.context();
  s.length_unit = "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.))";
  const int metre = s.context();
  const int rep = s.representation({test::add_box(s, {0, 0, 0}, {0.03, 0.02, 0.01})}, metre);
  const int part = s.product("part"), top = s.product("top");
  s.define(part, rep);
  const int from = s.axes({0, 0, 0}, kZ, kX), to = s.axes({100, 0, 0}, kZ, kX);
  const int top_rep = s.representation({to}, mm, "SHAPE_REPRESENTATION");
  s.define(top, top_rep);
  Assembly a;
  a.s = s, a.use(top, top_rep, part, rep, from, to);
  test::expect_truth(a.s.text(), kBox);
  EXPECT_NEAR(read_step(a.s.text(), "x")->artefact.box.max_mm.x(), 130, 1e-6);
}
TEST(Assemblies, ByMapsOfMaps) {
  Assembly a;
  StepText& s = a.s;
  const int origin = s.axes({0, 0, 0}, kZ, kX);
  const auto mapped = [&](int rep, int target) {
    return s.add("MAPPED_ITEM(''," + s.ref(s.add("REPRESENTATION_MAP(" + s.ref(origin) + "," + s.ref(rep) + ")")) + "," + s.ref(target) +
                 ")");
  };
  const int inner = s.representation({mapped(a.rep, s.axes({0, 100, 0}, kZ, kX)), mapped(a.rep, s.axes({0, 200, 0}, kZ, -kX))}, a.context,
                                     "SHAPE_REPRESENTATION");
  // The part's own product keeps its own body: it is placed once itself, twice through the map.
  const int outer = s.representation({mapped(inner, s.axes({500, 0, 0}, kZ, kX))}, a.context, "SHAPE_REPRESENTATION");
  s.define(s.product("maps"), outer);
  const auto r = read_step(s.text(), "x");
  ASSERT_TRUE(r);
  EXPECT_EQ(r->artefact.solids_count, 3);
  EXPECT_NEAR(r->artefact.box.max_mm.x(), 530, 1e-9);
}
TEST(Assemblies, MirroredAndScaled) {
  for (const double scale : {1.0, 2.0}) {
    StepText s;
    const int context = s.context(), origin = s.axes({0, 0, 0}, kZ, kX);
    const int rep = s.representation({test::add_box(s, {0, 0, 0}, {30, 20, 10})}, context),
              map = s.add("REPRESENTATION_MAP(" + s.ref(origin) + "," + s.ref(rep) + ")");
    const int x = s.direction(-kX), y = s.direction(kY), z = s.direction(kZ), p = s.point({0, 0, 0});
    const int t = s.add("(CARTESIAN_TRANSFORMATION_OPERATOR(" + s.ref(x) + "," + s.ref(y) + "," + s.ref(p) + "," + s.real(scale) +
                        ")CARTESIAN_TRANSFORMATION_OPERATOR_3D(" + s.ref(z) +
                        ")FUNCTIONALLY_DEFINED_TRANSFORMATION('','')GEOMETRIC_REPRESENTATION_ITEM()REPRESENTATION_ITEM(''))");
    s.define(s.product("m"),
             s.representation({s.add("MAPPED_ITEM(''," + s.ref(map) + "," + s.ref(t) + ")")}, context, "SHAPE_REPRESENTATION"));
    test::expect_truth(s.text(), {6000 * scale * scale * scale, 2200 * scale * scale, 240 * scale, 6, 1});
    EXPECT_NEAR(read_step(s.text(), "x")->artefact.box.min_mm.x(), -30 * scale, 1e-9);
  }
}
TEST(Assemblies, RelationshipJoinsPlacementAndBody) {  // as most systems write a single part
  StepText s;
  const int context = s.context(), origin = s.axes({0, 0, 0}, kZ, kX);
  const int body = s.representation({test::add_box(s, {0, 0, 0}, {30, 20, 10}), origin}, context),
            placement = s.representation({origin}, context, "SHAPE_REPRESENTATION");
  s.define(s.product("p"), placement);
  s.add("SHAPE_REPRESENTATION_RELATIONSHIP('',''," + s.ref(placement) + "," + s.ref(body) + ")");
  test::expect_truth(s.text(), kBox);
}
TEST(Assemblies, BodiesWithoutAnyProduct) {
  StepText s;
  s.representation({test::add_box(s, {0, 0, 0}, {30, 20, 10})}, s.context());
  test::expect_truth(s.text(), kBox);
  StepText bare;
  test::add_box(bare, {0, 0, 0}, {30, 20, 10});  // no representation either
  test::expect_truth(bare.text(), kBox);
}

}  // namespace
}  // namespace asbuilt
