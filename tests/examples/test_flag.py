"""The simulated flag: cloth and wind obey their laws, and a seed decides the whole set."""

from dataclasses import replace

import numpy as np
import pytest
from flag.cloth import AIR, GRAVITY, Fabric, Simulation, rectangle
from flag.noise import CORNER_GAIN, add_noise, noise_profile
from flag.quality import (
    count_intersections,
    edges_of,
    stretches,
    swing_angles,
)
from flag.wind import still_air, turbulent_wind

pytestmark = pytest.mark.slow

COLUMNS, ROWS, SPACING = 19, 13, 0.08


def small(**fabric):
    return rectangle(COLUMNS, ROWS, SPACING, Fabric(**fabric))


def untied(cloth):
    return replace(cloth, pinned=np.zeros(len(cloth.rest), bool))


@pytest.fixture(scope="module")
def example(load_example):
    return load_example("10_make_flag")


@pytest.fixture(scope="module")
def flown(example):
    return example.make_set(40, seed=3, cloth=small())


def test_grid_is_one_oriented_sheet_with_a_boundary():
    cloth = small()
    faces, V = cloth.faces, COLUMNS * ROWS
    assert len(faces) == 2 * (COLUMNS - 1) * (ROWS - 1)
    half = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert len(np.unique(half, axis=0)) == len(half)
    assert V - len(edges_of(faces)) + len(faces) == 1  # a disc
    a, b, c = cloth.rest[faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    np.testing.assert_allclose(normals, np.tile([0, -(SPACING**2), 0], (len(faces), 1)), atol=1e-12)
    area = (COLUMNS - 1) * (ROWS - 1) * SPACING**2
    assert cloth.mass.sum() == pytest.approx(cloth.fabric.density * area)
    # Every side once, both diagonals of every cell once, every straight run of three once.
    sides = (COLUMNS - 1) * ROWS + COLUMNS * (ROWS - 1)
    springs = np.unique(np.sort(cloth.springs, axis=1), axis=0)
    assert len(springs) == len(cloth.springs) == sides + len(faces)
    assert len(cloth.bends) == (COLUMNS - 2) * ROWS + COLUMNS * (ROWS - 2)
    i, j, k = cloth.bends.T
    np.testing.assert_allclose(cloth.rest[i] + cloth.rest[k], 2 * cloth.rest[j], atol=1e-12)


def test_at_rest_it_stays_at_rest():
    flag = Simulation(small(), still_air(), gravity=0.0)
    flag.run(0.2)
    np.testing.assert_allclose(flag.x, flag.cloth.rest, atol=1e-12)


def test_untied_without_air_it_falls_freely():
    flag = Simulation(untied(small(drag=0.0, friction=0.0)), still_air())
    flag.run(0.25)
    fallen = flag.cloth.rest - [0.0, 0.0, 0.5 * GRAVITY * 0.25**2]
    # Velocity first, then position: half a substep ahead.
    np.testing.assert_allclose(flag.x, fallen, atol=GRAVITY * 0.25 / (240 * 20))
    np.testing.assert_allclose(flag.v - [0, 0, -GRAVITY * 0.25], 0.0, atol=1e-9)


def test_inner_forces_keep_momentum_and_angular_momentum():
    cloth = untied(small(drag=0.0, friction=0.0))
    flag = Simulation(cloth, still_air(), gravity=0.0)
    flag.v[:] = 0.5 * np.random.default_rng(0).normal(size=flag.v.shape)
    mass = cloth.mass[:, None]
    before = (mass * flag.v).sum(0), np.cross(flag.x, mass * flag.v).sum(0)
    flag.run(0.05)
    np.testing.assert_allclose((mass * flag.v).sum(0), before[0], atol=1e-12)
    np.testing.assert_allclose(np.cross(flag.x, mass * flag.v).sum(0), before[1], atol=2e-4)


def test_air_pushes_a_flat_sheet_by_its_pressure_and_friction():
    cloth = untied(small())
    flag = Simulation(cloth, replace(still_air(), mean=np.array([3.0, 5.0, 0.0])), gravity=0.0)
    flag.steps, flag.substeps = 10**5, 1
    flag.run(1e-5)
    area = (COLUMNS - 1) * (ROWS - 1) * SPACING**2
    force = (cloth.mass[:, None] * flag.v).sum(axis=0) / 1e-5
    fabric = cloth.fabric
    expected = 0.5 * AIR * area * np.array([fabric.friction * 3.0**2, fabric.drag * 5.0**2, 0.0])
    np.testing.assert_allclose(force, expected, rtol=1e-3, atol=1e-9)


def test_elastic_energy_is_that_of_a_sheet():
    """Rolled on a cylinder of radius r: ½ D / r² an area; stretched by ε: ½ Y ε² an area."""
    cloth, r = rectangle(101, 5, 0.02, Fabric(membrane=1e-12, shear=1e-12)), 1.5
    rolled = cloth.rest.copy()
    rolled[:, 0], rolled[:, 1] = r * np.sin(rolled[:, 0] / r), r * (1 - np.cos(rolled[:, 0] / r))
    area = 99 * 5 * 0.02**2  # where a vertex has two neighbours along x
    expected = 0.5 * cloth.fabric.bending / r**2 * area
    assert cloth.energy(rolled, 0 * rolled) == pytest.approx(expected, rel=1e-3)

    cloth = rectangle(101, 5, 0.02, Fabric(bending=1e-12, shear=1e-12))
    longer = cloth.rest * [1.01, 1.0, 1.0]
    expected = 0.5 * cloth.fabric.membrane * 0.01**2 * (100 * 5 * 0.02**2)
    assert cloth.energy(longer, 0 * longer) == pytest.approx(expected, rel=1e-6)

    cloth = rectangle(41, 31, 0.02, Fabric(membrane=1e-12, bending=1e-12))
    sheared = cloth.rest + 1e-3 * cloth.rest[:, [2, 1, 0]] * [1.0, 0.0, 0.0]
    expected = 0.5 * cloth.fabric.shear * 1e-3**2 * (40 * 30 * 0.02**2)
    assert cloth.energy(sheared, 0 * sheared) == pytest.approx(expected, rel=1e-2)


def test_a_narrow_cantilever_bends_as_the_beam_formula_says():
    """A horizontal strip under a small weight: its end sinks by q L⁴ / 8 D."""
    fabric = Fabric(density=0.15, bending=0.05, drag=2000.0, friction=0.0)  # thick air: soon still
    strip = rectangle(13, 3, 0.05, fabric)
    strip = replace(strip, pinned=strip.rest[:, 0] < 0.06)  # two columns: clamped
    lying = strip.rest[:, [0, 2, 1]]
    flag = Simulation(replace(strip, rest=lying), still_air(), gravity=0.05)
    flag.run(3.0)
    # The clamp is midway between its columns' hinge and the pole; three rows of constraints bear
    # the weight of a strip that is two cells wide.
    length = 11.5 * 0.05
    sinks = 2 / 3 * 0.15 * 0.05 * length**4 / (8 * fabric.bending)
    assert -flag.x[-3:, 2].mean() == pytest.approx(sinks, rel=0.03)


def test_energy_decays_in_still_air():
    flag = Simulation(small(), still_air())
    flag.v[:, 1] = 3.0 * flag.x[:, 0]
    flag.v[flag.cloth.pinned] = 0.0
    energies = [flag.cloth.energy(flag.x, flag.v)]
    for _ in range(45):
        flag.run(1 / 30)
        energies.append(flag.cloth.energy(flag.x, flag.v))
    assert (np.diff(energies) < 1e-6 * energies[0]).all()
    assert energies[-1] < energies[0] - 0.5


def test_layers_of_a_fold_move_apart_and_do_not_cut():
    cloth = small()
    flag = Simulation(cloth, still_air(), gravity=0.0)
    middle = cloth.rest[:, 0].max() / 2
    behind = cloth.rest[:, 0] > middle
    flag.x[behind, 0] = 2 * middle - flag.x[behind, 0]
    apart = cloth.fabric.thickness * cloth.spacing
    flag.x[behind, 1] = 0.2 * apart
    flag.run(0.1)
    far = np.abs(np.subtract.outer(*2 * [np.arange(len(flag.x)) // ROWS])) > 2
    distance = np.linalg.norm(flag.x[:, None] - flag.x, axis=2)[far]
    assert distance.min() > 0.95 * apart
    assert count_intersections(flag.x, cloth.faces) == 0


def test_a_pierced_triangle_counts_once():
    points = np.array(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [3, 3, 1]], float
    )
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    assert count_intersections(points, faces) == 2  # edge 3-4, and edge 1-2 or 3-5
    points[3:, 0] += 2.0
    assert count_intersections(points, faces) == 0
    assert count_intersections(small().rest, small().faces) == 0


def test_wind_has_no_divergence_and_the_strength_asked_for():
    wind = turbulent_wind(np.random.default_rng(1), speed=7.0, intensity=0.3)
    points, step = np.random.default_rng(2).uniform(-200, 200, (4000, 3)), 1e-4
    slopes = [
        (wind.velocity(points + d, 0.4) - wind.velocity(points - d, 0.4)) / (2 * step)
        for d in step * np.eye(3)
    ]
    divergence = sum(slope[:, axis] for axis, slope in enumerate(slopes))
    assert np.abs(divergence).max() < 1e-6
    assert max(np.abs(slope).max() for slope in slopes) > 1.0  # and it does vary
    fluctuation = wind.velocity(points, 0.4) - [7.0, 0.0, 0.0]
    assert np.sqrt((fluctuation**2).mean()) == pytest.approx(0.3 * 7.0, rel=0.1)


def test_flag_swings_on_its_pole_without_being_stretched(flown):
    vertices, cloth = flown["vertices"], small()
    assert vertices.shape == (41, COLUMNS * ROWS, 3)
    assert vertices.dtype == np.float32
    np.testing.assert_array_equal(vertices[0], cloth.rest.astype(np.float32))
    pinned = vertices[:, cloth.pinned]
    np.testing.assert_array_equal(pinned, np.broadcast_to(pinned[0], pinned.shape))
    assert np.ptp(swing_angles(vertices[1:], cloth.shape)) > 20.0
    stretch = stretches(vertices[1:], edges_of(flown["faces"]), vertices[0])
    assert abs(np.median(stretch) - 1.0) < 0.005
    assert np.percentile(stretch, 99) < 1.03


def test_a_seed_decides_the_set(example, flown):
    again = example.make_set(3, seed=3, cloth=small())
    other = example.make_set(3, seed=4, cloth=small())
    np.testing.assert_array_equal(again["vertices"], flown["vertices"][:4])
    assert np.abs(other["vertices"] - again["vertices"]).max() > 0.01


def test_the_written_file_holds_the_set(example, flown, tmp_path, monkeypatch):
    monkeypatch.setattr(example, "rectangle", small)
    example.main(tmp_path / "deep" / "flag.npz", frames=2, seed=3)
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["flag.npz"]
    with np.load(tmp_path / "deep" / "flag.npz") as stored:
        np.testing.assert_array_equal(stored["vertices"], flown["vertices"][:3])
        np.testing.assert_array_equal(stored["faces"], flown["faces"])
        assert stored["vertices"].dtype == np.float32 and stored["faces"].dtype == np.int32


def test_noise_is_worst_at_the_free_corners_and_spares_the_reference(example):
    cloth = small()
    frames = np.broadcast_to(cloth.rest, (3001, *cloth.rest.shape))
    noise = add_noise(frames, 0.002, np.random.default_rng(0)) - cloth.rest
    assert not noise[0].any()
    deviation = noise[1:].std(axis=(0, 2))
    np.testing.assert_allclose(deviation, 0.002 * noise_profile(cloth.rest), rtol=0.05)
    assert deviation[[-ROWS, -1]] == pytest.approx(0.002 * CORNER_GAIN, rel=0.05)
    assert deviation[0] == pytest.approx(0.002, rel=0.05)
    clean = example.make_set(2, seed=3, cloth=cloth)["vertices"]
    noisy = example.make_set(2, seed=3, noise=0.001, cloth=cloth)["vertices"]
    assert 0 < np.abs(noisy - clean)[1:].max() < 0.04
    np.testing.assert_array_equal(noisy[0], clean[0])
