//! The targets. naga writes them; what is added here are the names of calls, which its writers leave out.

use super::lower::CallName;
use super::{EmitError, Shader, chain};
use naga::back::{glsl, hlsl, msl, spv, wgsl};
use naga::{AddressSpace, ResourceBinding};
use rustc_hash::FxHashMap;

fn target(target: &'static str) -> impl Fn(&dyn std::error::Error) -> EmitError {
    move |e| EmitError::Target { target, message: chain(e) }
}

impl Shader {
    /// The WGSL text.
    ///
    /// # Errors
    /// [`EmitError::Target`] if naga cannot write it, which no valid kernel is known to bring about.
    pub fn wgsl(&self) -> Result<String, EmitError> {
        let text = wgsl::write_string(&self.module, &self.info, wgsl::WriterFlags::empty());
        Ok(name_calls(&text.map_err(|e| target("WGSL")(&e))?, &self.calls, &self.entry))
    }

    /// The SPIR-V words, version 1.3, with names kept for debuggers. Bindings are those of the kernel in set 0.
    ///
    /// # Errors
    /// [`EmitError::Target`] if naga cannot write it.
    pub fn spirv(&self) -> Result<Vec<u32>, EmitError> {
        let options = spv::Options {
            lang_version: (1, 3),
            flags: spv::WriterFlags::DEBUG,
            // Loops have a cap of their own.
            force_loop_bounding: false,
            ..spv::Options::default()
        };
        spv::write_vec(&self.module, &self.info, &options, None).map_err(|e| target("SPIR-V")(&e))
    }

    /// GLSL 4.30. The entry point is `main`; bindings are those of the kernel.
    ///
    /// # Errors
    /// [`EmitError::Target`] if naga cannot write it.
    pub fn glsl(&self) -> Result<String, EmitError> {
        let error = target("GLSL");
        let mut options = glsl::Options { version: glsl::Version::Desktop(430), ..glsl::Options::default() };
        options.writer_flags = glsl::WriterFlags::empty();
        for (binding, _) in self.bindings() {
            let slot = u8::try_from(binding.binding).map_err(|e| error(&e))?;
            options.binding_map.insert(binding, slot);
        }
        let pipeline = glsl::PipelineOptions {
            shader_stage: self.module.entry_points[0].stage,
            entry_point: self.entry.clone(),
            multiview: None,
        };
        let policies = naga::proc::BoundsCheckPolicies::default();
        let mut text = String::new();
        let mut writer = glsl::Writer::new(&mut text, &self.module, &self.info, &options, &pipeline, policies)
            .map_err(|e| error(&e))?;
        writer.write().map_err(|e| error(&e))?;
        let calls: Vec<CallName> = self
            .calls
            .iter()
            .map(|c| CallName {
                function: if c.function == self.entry { "main".into() } else { c.function.clone() },
                ..c.clone()
            })
            .collect();
        Ok(name_calls(&text, &calls, "main"))
    }

    /// HLSL for shader model 6.0. Registers have the numbers of the kernel's bindings, in space 0.
    ///
    /// # Errors
    /// [`EmitError::Target`] if naga cannot write it.
    pub fn hlsl(&self) -> Result<String, EmitError> {
        let error = target("HLSL");
        let mut options = hlsl::Options {
            shader_model: hlsl::ShaderModel::V6_0,
            fake_missing_bindings: false,
            force_loop_bounding: false,
            ..hlsl::Options::default()
        };
        for (binding, _) in self.bindings() {
            let bind = hlsl::BindTarget { space: 0, register: binding.binding, ..hlsl::BindTarget::default() };
            options.binding_map.insert(binding, bind);
        }
        let pipeline = hlsl::PipelineOptions { entry_point: None };
        let mut text = String::new();
        let mut writer = hlsl::Writer::new(&mut text, &options, &pipeline);
        writer.write(&self.module, &self.info, None).map_err(|e| error(&e))?;
        Ok(name_calls(&text, &self.calls, &self.entry))
    }

    /// Metal 2.0. Buffers and textures are counted apart, each in the order of the kernel's bindings.
    ///
    /// # Errors
    /// [`EmitError::Target`] if naga cannot write it.
    pub fn msl(&self) -> Result<String, EmitError> {
        let error = target("MSL");
        let mut resources = msl::EntryPointResources::default();
        let (mut buffers, mut textures) = (0u8, 0u8);
        for (binding, space) in self.bindings() {
            let mut bind = msl::BindTarget::default();
            let counter = if space == AddressSpace::Handle { &mut textures } else { &mut buffers };
            *(if space == AddressSpace::Handle { &mut bind.texture } else { &mut bind.buffer }) = Some(*counter);
            bind.mutable =
                matches!(space, AddressSpace::Storage { access } if access.contains(naga::StorageAccess::STORE));
            *counter = counter.checked_add(1).ok_or(std::fmt::Error).map_err(|e| error(&e))?;
            resources.resources.insert(binding, bind);
        }
        resources.sizes_buffer = Some(buffers);
        let mut options = msl::Options {
            lang_version: (2, 0),
            fake_missing_bindings: false,
            force_loop_bounding: false,
            ..msl::Options::default()
        };
        options.per_entry_point_map.insert(self.entry.clone(), resources);
        let pipeline = msl::PipelineOptions::default();
        let (text, _) = msl::write_string(&self.module, &self.info, &options, &pipeline).map_err(|e| error(&e))?;
        Ok(name_calls(&text, &self.calls, &self.entry))
    }

    /// The module as naga prints it: for those who look for the reason of something in a target's text.
    #[must_use]
    pub fn naga_text(&self) -> String {
        format!("{:#?}\n", self.module)
    }

    fn bindings(&self) -> impl Iterator<Item = (ResourceBinding, AddressSpace)> {
        self.module.global_variables.iter().filter_map(|(_, g)| Some((g.binding?, g.space)))
    }
}

/// Puts names for the `_e7` that stand for the results of calls. The texts are naga's: no comments, and only what stands outside of
/// functions begins at the edge.
fn name_calls(text: &str, calls: &[CallName], entry: &str) -> String {
    let mut names: FxHashMap<&str, FxHashMap<usize, &str>> = FxHashMap::default();
    for c in calls {
        names.entry(&c.function).or_default().insert(c.number, &c.name);
    }
    names.entry(entry).or_default();
    let mut out = String::with_capacity(text.len());
    let mut current = None;
    for line in text.split_inclusive('\n') {
        if line.starts_with(|c: char| c.is_ascii_alphabetic() || c == '}') {
            let called = line.split('(').filter_map(|part| part.rsplit(|c| !is_word(c)).next());
            current = called.filter_map(|word| names.get(word)).next();
        }
        let mut rest = line;
        while let Some((known, at)) = current.zip(rest.find("_e")) {
            let (before, found) = rest.split_at(at);
            let length = found.find(|c| !is_word(c)).unwrap_or(found.len());
            let (word, after) = found.split_at(length);
            let whole = !before.ends_with(is_word);
            let name = word[2..].parse().ok().filter(|_| whole).and_then(|n: usize| known.get(&n));
            out.push_str(before);
            out.push_str(name.copied().unwrap_or(word));
            rest = after;
        }
        out.push_str(rest);
    }
    out
}

fn is_word(c: char) -> bool {
    c.is_ascii_alphanumeric() || c == '_'
}
