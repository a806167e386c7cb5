from model.generation.clip_noise import clip_seed


def test_clips_of_a_set_have_seeds_of_their_own_that_never_change():
    assert clip_seed(0, "garden") == 1_008_839_452
    seeds = {clip_seed(seed, name) for seed in range(50) for name in ("a", "b", "a b", "0 a")}
    assert len(seeds) == 200
    assert all(0 <= seed < 2**31 for seed in seeds)
