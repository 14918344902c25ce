"""Learned policies in files: reading them, asking them, and writing them as Soter or C.

Files of Stable-Baselines3 are read here without torch, pickles as data: nothing of a file is
imported or called.

In reading order:
- `policy_extern.py` makes a policy the step of an extern node; `policy_errors.py` says what is
  wrong with its file.
- `network.py`: the layers that files are read into, and what they answer in float32.
- `onnx_file.py` reads ONNX; `onnx_session.py` asks onnxruntime for the answer.
- `sb3_file.py` reads a policy of Stable-Baselines3: `sb3_zip.py` opens its file, `sb3_tensors.py`,
  `sb3_spaces.py` and `sb3_statistics.py` read its parts, `pickle_data.py` pickles.
- `soter_source.py` writes a network as Soter, with a bound of its error, `c_source.py` as C.
"""
